"""A case in the form that an entry receives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, brief
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.recordings import Recording, Recordings, load_recordings
from embodiedreamer_gym.recordings.plain_csv import read_commands, read_plain_csv
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import run_sets, simulate


@dataclass(frozen=True, eq=False)
class Task:
    """One case.

    case: its number as text; folder: the folder of its files; effects: names that an answer may use.
    train, test: recordings for fitting, and held-out recordings for testing.
    predict: motions whose signal is to be predicted: recordings whose position (or effort, if they have no command) is
        a constant placeholder.
    """

    case: str
    folder: Path
    observation: str
    effects: tuple[str, ...]
    model: RobotModel
    train: Recordings
    test: Recordings
    predict: tuple[Recording, ...]

    @property
    def signal(self) -> str:
        """The signal to predict: "position" or "effort"."""
        return signal_of(self.predict[0])

    def run(self, model: RobotModel, recording: Recording) -> np.ndarray:
        """Simulated signal of a model for a recording's motion: position (T, n), or effort if there is no command.

        Raises: SimulationError if the simulation diverges.
        """
        if signal_of(recording) == "effort":
            return run_sets(model, [recording])[0].effort[0]
        return simulate(model, recording).position

    def predictions(self, model: RobotModel) -> dict[str, np.ndarray]:
        """Predictions (T, n) of a model by name of the motion."""
        return {motion.name: self.run(model, motion) for motion in self.predict}


def signal_of(recording: Recording) -> str:
    """The compared signal: "effort" if the recording has no command, else "position"."""
    return "effort" if recording.command is None else "position"


def load_task(folder: Path) -> Task:
    """Read a case's folder.

    Raises: EmbodieDreamerError for files that are missing or damaged.
    """
    data = read_json(folder / "case.json", what="case")
    try:
        starts = {str(name): dict(row) for name, row in data["predict"].items()}
        case, observation, effects = str(data["case"]), str(data["observation"]), tuple(map(str, data["effects"]))
        motions = tuple(_motion(folder / "predict" / f"{name}.csv", start) for name, start in sorted(starts.items()))
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        if isinstance(error, EmbodieDreamerError):
            raise
        raise EmbodieDreamerError(f"{folder / 'case.json'} is not a case of the benchmark: {brief(error)}.") from error
    train, test = (load_recordings(folder / part) for part in ("train", "test"))
    return Task(case, folder, observation, effects, RobotModel.load(folder / "model.json"), train, test, motions)


def _motion(path: Path, start: dict[str, Any]) -> Recording:
    """A motion to predict, with a placeholder for the withheld signal."""
    with path.open(encoding="utf-8") as file:
        rest = file.readline().partition(":")[2].strip()
        by_command = ".command" in file.readline()
    if not by_command:
        log = read_plain_csv(path)
        return log.with_(effort=np.zeros(log.position.shape), effort_unit="N m")
    joints, time, command = read_commands(path)
    place = np.array([float(start[joint]) for joint in joints])
    if not np.isfinite(place).all():
        file = path.parent.parent / "case.json"
        raise EmbodieDreamerError(f"{file} is not a case of the benchmark: the start of {path.stem} is not finite.")
    hold = rest if rest in ("linear", "hold") else "unknown"
    still = np.tile(place, (len(time), 1))
    return Recording(path.stem, joints, time, still, command, command_hold=hold, noise=np.full(len(joints), 1e-3))
