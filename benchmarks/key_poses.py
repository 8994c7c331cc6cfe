"""Key poses with the objects' true poses: how far planning and control carry, and what tracking through the calibrated model is worth.

python -m benchmarks key_poses --out DIR [--task NAME ...] [--world nominal stand-in]
                               [--mode nominal off trim feed_forward both] [--demos 50] [--episodes 40] [--first-seed 830000]

Key poses are learnt from recorded demonstrations, with the objects' poses that the files state. `nominal` is the simulator of
the demonstrations. `stand-in` is the world of `closed_loop` without pictures; its modes are those of `CalibratedTracking`, by the
model that `closed_loop` fits to logs of the robot, and nominal: both, by the model that knows of no effect.
Episodes and the model are kept in DIR.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.closed_loop import TASKS, calibrated, hidden
from benchmarks.common import clopper_pearson, pin_threads, save

WORLDS = ("nominal", "stand-in")
MODES = ("nominal", "off", "trim", "feed_forward", "both")
CHUNK = 300


def lying(position: np.ndarray, quaternion: np.ndarray) -> tuple[float, float, float]:
    """Place (m) of a thing on the table, and the direction (rad) of its x axis."""
    from scipy.spatial.transform import Rotation

    axis = Rotation.from_quat(quaternion).as_matrix()[:, 0]
    return float(position[0]), float(position[1]), float(np.arctan2(axis[1], axis[0]))


def skill_of(a: argparse.Namespace, task: str) -> Any:
    """Key poses of a task's demonstrations, and the arms."""
    import h5py

    from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
    from embodiedreamer_gym.policies.key_pose import Demonstration, learn
    from embodiedreamer_gym.policies.key_pose.arms import Arms
    from embodiedreamer_gym.robot import RobotModel

    folder = a.out / task
    record_demonstrations(Demonstrations(task), a.demos, folder)
    shown = []
    for number in range(a.demos):
        with h5py.File(folder / f"episode_{number}.hdf5") as file:
            things = {name: np.asarray(file[f"objects/{name}"])[0] for name in file["objects"]}  # pyright: ignore
            states, actions = (np.asarray(file[key], float) for key in ("observations/qpos", "action"))
        scene = {name: lying(pose[:3], pose[3:]) for name, pose in things.items()}
        shown.append(Demonstration(states, actions, 30.0, scene))
    return learn(shown, Arms(RobotModel.load("aloha")))


def wrapper(a: argparse.Namespace, mode: str, world: str) -> Callable[[Any], Any]:
    """What puts `CalibratedTracking` around an environment."""
    from embodiedreamer_gym.wrappers import CalibratedTracking

    model = "aloha" if world == "nominal" or mode in ("nominal", "off", "trim") else str(calibrated(a.out))
    return lambda env: CalibratedTracking(env, model, "both" if mode == "nominal" else mode)


def judged(a: argparse.Namespace, task: str, skill: Any, world: str, mode: str) -> dict[str, Any]:
    """A row of the table."""
    import gymnasium as gym

    from embodiedreamer_gym.envs import task_id
    from embodiedreamer_gym.policies.evaluation import play
    from embodiedreamer_gym.policies.key_pose import KeyPosePolicy
    from embodiedreamer_gym.robot import RobotModel
    from embodiedreamer_gym.standin.bench import make_stand_in
    from embodiedreamer_gym.wrappers import ActionChunk

    wrap = wrapper(a, mode, world)
    if world == "nominal":
        env = ActionChunk(wrap(gym.make(task_id(task), image_size=(16, 12), disable_env_checker=True)), CHUNK)
    else:
        env = make_stand_in(task, hidden(), chunk=CHUNK, pictures="none", wrap=wrap)
    aloha: Any = env.unwrapped

    def look(_: Any) -> dict[str, tuple[float, float, float]]:
        poses = {prop.name: aloha.object_pose(prop.name) for prop in aloha.task.props}
        return {name: lying(pose.position, pose.quaternion) for name, pose in poses.items()}

    policy = KeyPosePolicy(skill, RobotModel.load("aloha"), look, 30.0)
    rows = [play(policy, env, a.first_seed + number, CHUNK) for number in range(a.episodes)]
    env.close()
    hits = sum(row.success for row in rows)
    low, high = clopper_pearson(hits, len(rows))
    return {"task": task, "world": world, "tracking": mode, "picked_up": sum(row.grasped for row in rows),
            "hits": hits, "of": len(rows), "low": low, "high": high}  # fmt: skip


def line(row: dict[str, Any]) -> str:
    """A row as a line of the table."""
    share = "{hits} of {of}, {:.1%} ({low:.1%} .. {high:.1%})".format(row["hits"] / row["of"], **row)
    return f"| {row['task']} | {row['world']} | {row['tracking']} | {row['picked_up']} | {share} |"


def main() -> None:
    """Record what is missing, play and print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--json", type=Path, help="rows of the table as JSON")
    parser.add_argument("--task", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--world", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument("--mode", nargs="+", choices=MODES, default=list(MODES), help="in the stand-in world")
    for name, value in (("demos", 50), ("episodes", 40), ("first-seed", 830_000)):
        parser.add_argument(f"--{name}", type=int, default=value)
    a = parser.parse_args()
    pin_threads()
    import embodiedreamer_gym  # noqa: F401  its environments are registered

    print("| task | world | tracking | picked up | success |\n|---|---|---|---|---|")
    rows: list[dict[str, Any]] = []
    for task in a.task:
        skill = skill_of(a, task)
        for world in a.world:
            for mode in ["nominal"] if world == "nominal" else a.mode:
                rows.append(judged(a, task, skill, world, mode))
                print(line(rows[-1]), flush=True)
                save(rows, a.json)


if __name__ == "__main__":
    main()
