"""Replays recorded episodes from the same start, with the view of a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.aloha import AlohaEpisodes
from embodiedreamer_gym.recordings.files import natural
from embodiedreamer_gym.recordings.hdf5 import EFFORT, SUFFIXES, VELOCITY, Hdf5File, open_hdf5
from embodiedreamer_gym.vis_aligner import Condition
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.vis_aligner import conditions

SIGNALS = {VELOCITY: "velocities", EFFORT: "efforts"}


@dataclass(frozen=True, eq=False)
class Source:
    """A recorded episode without its frames, and its start.

    states, actions (T, 14); velocities, efforts (T, 14) or None; objects: name -> poses (T, 7), position m and
    quaternion xyzw; options: of the environment's reset; seed: of the reset, None if the options define the start.
    """

    path: Path
    task: str
    robot: str
    hz: float
    instruction: str
    states: np.ndarray
    actions: np.ndarray
    velocities: np.ndarray | None
    efforts: np.ndarray | None
    objects: Mapping[str, np.ndarray]
    attributes: Mapping[str, Any]
    seed: int | None

    @property
    def name(self) -> str:
        """Name of the file without its suffix."""
        return self.path.stem

    @property
    def options(self) -> dict[str, Any] | None:
        """Options of the reset; None with a seed."""
        if self.seed is not None:
            return None
        poses = {name: poses[0] for name, poses in self.objects.items()}
        return {"joint_positions": self.states[0], "command": self.actions[0], "object_poses": poses}


@dataclass(frozen=True, eq=False)
class Played:
    """A replay: what the cameras see before each of the T actions, and the outcome.

    views: of each camera, by its name; names: of the classes; success: of the task after the last action; error: largest difference of a joint, in the
    action's units, between replay and recording at the last recorded state.
    """

    views: Mapping[str, Condition]
    names: tuple[str, ...]
    success: bool
    error: float


def source_files(episodes: str | Path | Sequence[str | Path]) -> list[Path]:
    """The HDF5 files in the given files and folders, in natural order.

    Raises: RecordingError if there is none, one is damaged, or two have the same name.
    """
    given = [episodes] if isinstance(episodes, str | Path) else list(episodes)
    found: list[Path] = []
    for one in (Path(path).expanduser() for path in given):
        inside = sorted(one.iterdir(), key=natural) if one.is_dir() else [one]
        files = [path for path in inside if path.suffix in SUFFIXES and not path.name.startswith(".")]
        if not files:
            raise RecordingError(f"{one}: there is no HDF5 episode; only those can be replayed.")
        found += files
    names = [path.stem for path in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(
            f"two episodes are named {twice[0]}; process the input folders one at a time, each into its own output folder."
        )
    if found:
        AlohaEpisodes(found)
    return found


def read_source(path: Path, task: str | None = None, robot: str | None = None) -> Source:
    """Read a recorded episode; task, robot: override those in the file.

    Raises: RecordingError if its task or its objects' poses are missing, or it is too short.
    """
    episode = AlohaEpisodes([path])
    with open_hdf5(path) as file:
        attributes = dict(file.file.attrs.items())
        objects = file.object_poses()
        signals = {name: file.signal(key) if key in file else None for key, name in SIGNALS.items()}
        about = _demonstration(file)
    task = task or about.get("task") or str(attributes.get("task", ""))
    if task not in TASKS:
        raise RecordingError(f"{path} does not state its task; give one of {', '.join(TASKS)}.")
    seed = attributes["seed"] if about and "seed" in attributes else None
    if seed is not None and not isinstance(seed, int | np.integer):
        raise RecordingError(f"{path}: the attribute seed is no whole number.")
    seed = None if seed is None else int(seed)
    if seed is None:
        _check_objects(path, task, objects)
    if episode.lengths[0] < 2:
        raise RecordingError(f"{path} has one step only; an episode to be replayed has more.")
    return Source(
        path, task, robot or about.get("robot", "aloha"), episode.hz, episode.task(0), episode.states(0),
        episode.actions(0), **signals, objects=objects, attributes=attributes, seed=seed,
    )  # fmt: skip


def play(source: Source, size: tuple[int, int], cameras: Sequence[str] = ("head",)) -> Played:
    """Play an episode's actions from its start; size: width and height of the pictures of the cameras.

    Raises: SimulationError or ModelError for an invalid robot, rate or start.
    """
    env = AlohaEnv(source.task, source.robot, "state", image_size=size, control_hz=round(source.hz))
    try:
        if source.actions.shape[1] != env.robot.n:
            raise RecordingError(
                f"{source.path} has {source.actions.shape[1]} numbers in an action, the robot takes {env.robot.n}."
            )
        film = ActionChunk(env, len(source.actions) - 1, cameras, size)
        _, info = film.reset(seed=source.seed, options=source.options)
        begun = {name: seen.part(0, 1) for name, seen in conditions(info, cameras).items()}
        *_, info = film.step(source.actions[:-1])
        seen, error = conditions(info, cameras), float(np.abs(env.joint_positions() - source.states[-1]).max())
        success = bool(env.step(source.actions[-1])[4]["is_success"])
        views = {name: Condition.joined([begun[name], seen[name]]) for name in cameras}
        return Played(views, env.segmentation_classes, success, error)
    finally:
        env.close()


def _demonstration(file: Hdf5File) -> dict[str, Any]:
    """Settings of a demonstration; {} for other files."""
    settings = file.json("demonstration", {})
    return settings if isinstance(settings, dict) else {}


def _check_objects(path: Path, task: str, objects: Mapping[str, np.ndarray]) -> None:
    """Raise unless the poses of all objects of a task are known."""
    wanted = {prop.name for prop in TASKS[task]().props}
    if set(objects) != wanted:
        raise RecordingError(
            f"{path} needs the poses of the task's objects, {', '.join(f'/objects/{n}' for n in sorted(wanted))}, "
            f"and has {', '.join(f'/objects/{n}' for n in objects) or 'none'}."
        )
