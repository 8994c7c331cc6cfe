"""Plans joint angles that move an arm to an object, lift it, carry it to the goal and retreat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from embodiedreamer_gym.envs.tasks.task import Situation, Task
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot.kinematics import Kinematics
from embodiedreamer_gym.robot.paths import Path, line

BACK = 0.08  # m: distance from which a gripper approaches, and to which it retreats
LIFT = 0.10  # m
ABOVE = 0.06  # m above its final position, from which an object is lowered
GENTLE, BRISK = 0.2, 0.4  # m/s, of the end effector, towards objects and away from them
READY = np.array([0.0, 1.6, -1.5, 0.0, 0.8, 0.0])  # rad: second start of inverse kinematics

Paths = tuple[Path, Path, Path]


class Planner:
    """Plans paths of one arm for a task; deterministic and without physics."""

    def __init__(self, arm: Kinematics, task: Task) -> None:
        self.arm, self.task = arm, task

    def pick(self, now: Situation, start: np.ndarray) -> Paths | None:
        """Paths from angles (m,) to near the object, to it, and up, for the first grip that can also reach the goal."""
        for grip in self.task.grips(now):
            paths = self._join(start, moved(grip, ahead=-BACK), grip, moved(grip, up=LIFT))
            if paths is not None and (self.task.goal is None or self.place(replace(now, tip=grip), paths[-1].end)):
                return paths
        return None

    def place(self, held: Situation, start: np.ndarray) -> Paths | None:
        """Paths from angles (m,) to above the goal, down to it and away, for the first reachable release."""
        for release in self.task.releases(held):
            paths = self._join(start, moved(release, up=ABOVE), release, moved(release, ahead=-BACK))
            if paths is not None:
                return paths
        return None

    def _join(self, start: np.ndarray, first: Pose, second: Pose, third: Pose) -> Paths | None:
        """Paths from angles (m,) to a pose in joint space, then straight to two more."""
        at = self._reach(first, start)
        to = None if at is None else line(self.arm, at, second, GENTLE)
        off = None if to is None else line(self.arm, to.end, third, BRISK)
        return None if at is None or to is None or off is None else (Path(np.array([start, at])), to, off)

    def _reach(self, pose: Pose, start: np.ndarray) -> np.ndarray | None:
        """Angles (m,) that reach a pose: near the start angles, else near those of an arm that faces it."""
        base = self.arm.base
        ahead = float(np.arctan2(*(pose.position - base)[1::-1]))
        for guess in (start, np.array([ahead, *READY[1:]])):
            found = self.arm.solve(pose.position, pose.rotation, guess)
            if found is not None:
                return found
        return None


def moved(pose: Pose, ahead: float = 0.0, up: float = 0.0) -> Pose:
    """A gripper's pose moved along the direction it points in, and upwards, m."""
    return Pose(pose.position + ahead * pose.rotation[:, 2] + [0.0, 0.0, up], pose.quaternion)
