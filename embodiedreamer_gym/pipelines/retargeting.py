"""Recorded demonstrations retargeted to new scenes: the motion between their key poses is planned again for other objects' poses."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.pipelines.key_pose_scenes import lying, shown_in
from embodiedreamer_gym.pipelines.replay_episodes import source_files
from embodiedreamer_gym.policies.key_pose import Demonstration, KeyPosePolicy, Skill, learn
from embodiedreamer_gym.policies.key_pose.arms import Arms
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.wrappers.calibrated_tracking import CalibratedTracking


class RetargetedExpert:
    """Plays one episode of an ALOHA environment with key poses, as `ScriptedExpert` does with a script; make one after each reset.

    The objects' poses come from the simulator, and the commands from the robot's own model. If no motion is found, the
    arms do not move.
    """

    def __init__(self, env: AlohaEnv, skill: Skill) -> None:
        scene = {prop.name: lying(env.object_pose(prop.name)) for prop in env.task.props}
        state = env.joint_positions()
        self._way = KeyPosePolicy(skill, env.robot, lambda _: scene, env.control_hz)({"agent_pos": state[None]})[0]
        self._tracking, self._env, self._played = CalibratedTracking(env, env.robot), env, 0
        self._tracking.tracker.reset(state, env.command)
        self._tracking.preview(self._way)

    def act(self) -> np.ndarray:
        """The next command (n,)."""
        number = min(self._played, len(self._way) - 1)
        self._played += 1
        return self._tracking.command(self._way[number])


def skill_of(folder: str, task: str, robot: str) -> Skill:
    """Key poses of the episodes in a folder.

    Raises: RecordingError for episodes of another task, or without the objects' poses; PolicyError for episodes from
    which key poses cannot be learnt.
    """
    return _learnt(folder, task, robot, _stamp(folder))


def digest(folder: str, task: str) -> str:
    """SHA-256 of the motions of the episodes in a folder, and of their objects' poses."""
    total = hashlib.sha256()
    for one in _shown(folder, task, _stamp(folder)):
        total.update(one.states.tobytes() + one.actions.tobytes() + repr(sorted(one.scene.items())).encode())
    return total.hexdigest()


def _stamp(folder: str) -> tuple[tuple[str, int, int], ...]:
    """Name, time of change and size of each file, which differ after a change."""
    seen = [(path.name, path.stat()) for path in source_files(folder)]
    return tuple((name, about.st_mtime_ns, about.st_size) for name, about in seen)


@lru_cache(maxsize=1)
def _learnt(folder: str, task: str, robot: str, stamp: tuple[tuple[str, int, int], ...]) -> Skill:
    """Key poses, learnt once for all attempts of a process."""
    return learn(_shown(folder, task, stamp), Arms(RobotModel.load(robot)))


@lru_cache(maxsize=1)
def _shown(folder: str, task: str, stamp: tuple[tuple[str, int, int], ...]) -> tuple[Demonstration, ...]:
    """The episodes in a folder, read once for each `stamp`."""
    recorded, shown = shown_in(Path(folder))
    if recorded != task:
        raise RecordingError(
            f"the episodes in {folder} are of {recorded}, not {task}; key poses are those of one task."
        )
    return tuple(shown)
