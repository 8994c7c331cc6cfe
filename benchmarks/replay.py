"""Replay: the diagnosed model, loaded from its file, must behave in PyBullet as in the diagnosis.

A stand-in robot with a hidden effect is diagnosed; the better model is saved, loaded and played in PyBullet with the
recorded commands, both training and held-out. The error of each joint must match that of `compare` within 0.1 mrad, and
must not match after the effect is deleted from the file. The commands of a pair of ALOHA arms go through `env.step` of
an environment made from the file.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import save
from embodiedreamer_gym.diagnosis import compare, diagnose
from embodiedreamer_gym.engines.bullet.plant import BulletPlant
from embodiedreamer_gym.engines.plant import replay
from embodiedreamer_gym.envs.replay import replay as replay_actions
from embodiedreamer_gym.recordings import Recording, load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import aloha_case, draw_case

ENV, PAIR = "EmbodieDreamer/PutCupOnMat-v0", "aloha"
CASES = (
    ("coulomb_friction", "arm6"),
    ("command_delay", "arm6"),
    ("payload", "arm6b"),
    ("torque_saturation", "arm7"),
    ("coulomb_friction", PAIR),
)
TOLERANCE = 1e-4  # rad


@dataclass(frozen=True, eq=False)
class Replayed:
    """Per-joint errors (n,) rad: from `compare`, in PyBullet from the file, and with the effect deleted.

    joints: joints on which the effects act.
    """

    effects: tuple[str, ...]
    joints: frozenset[str]
    compared: np.ndarray
    replayed: np.ndarray
    without: np.ndarray | None

    @property
    def gap(self) -> float:
        """Largest difference between `compare` and the replay over joints, rad."""
        return float(np.abs(self.replayed - self.compared).max())

    @property
    def gap_without(self) -> float:
        """The same with the effect deleted from the file, rad."""
        return np.nan if self.without is None else float(np.abs(self.without - self.compared).max())

    @property
    def holds(self) -> bool:
        """Whether the file reproduces the finding: the replay agrees with `compare`, but not without the effect."""
        return self.gap < TOLERANCE and self.gap_without > TOLERANCE


def in_plant(path: Path, recordings: Sequence[Recording]) -> list[np.ndarray]:
    """Positions (T, n) rad of a saved model in PyBullet under the commands of recordings."""
    model = RobotModel.load(path)
    return [replay(BulletPlant(model), recording).position for recording in recordings]


def in_environment(path: Path, recordings: Sequence[Recording]) -> list[np.ndarray]:
    """As `in_plant`, with the commands passed to `env.step` of an environment made from the file."""
    env = gym.make(ENV, robot=str(path), obs_type="state", collisions=False)
    positions = [replay_actions(env, recording) for recording in recordings]
    env.close()
    return positions


def joint_errors(positions: Sequence[np.ndarray], recordings: Sequence[Recording]) -> np.ndarray:
    """Each joint's rms (n,) over all usable samples of the recordings."""
    pairs = list(zip(positions, recordings, strict=True))
    squares = sum((np.where(r.usable, r.position - p, 0.0) ** 2).sum(axis=0) for p, r in pairs)
    return np.sqrt(squares / sum(r.usable.sum(axis=0) for r in recordings))


def round_trip(
    model: RobotModel,
    recordings: Sequence[Recording],
    folder: Path,
    play: Callable[[Path, Sequence[Recording]], list[np.ndarray]] = in_plant,
) -> Replayed:
    """Save the model as B.json, load and replay it; then replay it without the effects in the file."""
    path = folder / "B.json"
    model.save(path)
    compared = compare(model, recordings).joint_rms[0]
    replayed = joint_errors(play(path, recordings), recordings)
    without = None
    if model.effects:
        data = json.loads(path.read_text())
        path.write_text(json.dumps({**data, "effects": [], "intervals": {}}))
        without = joint_errors(play(path, recordings), recordings)
    joints = frozenset(joint for e in model.effects for values in e.values.values() for joint in values)
    return Replayed(tuple(e.name for e in model.effects), joints, compared, replayed, without)


def run(effect: str, arm: str, seed: int, jobs: int = 2) -> Replayed:
    """Draw a robot, diagnose it and replay the finding."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        if arm == PAIR:
            case = aloha_case(effect, "left", rng, "strong", episodes=4, seconds=8.0)
            model = RobotModel.load(case.write(name))
            train, test = (load_recordings(f"{name}/{part}/*.hdf5", hz=30.0) for part in ("train", "test"))
            found = diagnose(model, train, test, max_effects=1, jobs=jobs)
            return round_trip(found.model, test, Path(name), in_environment)
        case = draw_case(effect, arm, rng)
        model = RobotModel.load(case.write(name))
        found = diagnose(model, case.train, case.test, jobs=jobs)
        return round_trip(found.model, [*case.train, *case.test], Path(name))


def main(arguments: list[str] | None = None) -> int:
    """Print the table; returns 1 when a replay does not confirm its diagnosis."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effect", help="one effect instead of four")
    parser.add_argument("--arm", default="arm6")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args(arguments)
    cases = ((chosen.effect, chosen.arm),) if chosen.effect else CASES
    print(f"{'hidden':<18} {'arm':<6} {'named':<32} {'error':>8} {'gap':>9} {'without':>9}   mrad, worst joint")
    rows: list[dict[str, Any]] = []
    for effect, arm in cases:
        result = run(effect, arm, chosen.seed, chosen.jobs)
        worst = 1e3 * result.compared.max()
        named = ", ".join(result.effects) or "-"
        gaps = f"{1e3 * result.gap:>9.5f} {1e3 * result.gap_without:>9.3f}"
        print(
            f"{effect:<18} {arm:<6} {named:<32} {worst:>8.3f} {gaps}   {'ok' if result.holds else 'FAILED'}", flush=True
        )
        rows.append(
            {
                "hidden": effect,
                "arm": arm,
                "named": result.effects,
                "gap": result.gap,
                "gap_without": result.gap_without,
                "holds": result.holds,
            }
        )
        save(rows, chosen.out)
    return int(not all(row["holds"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
