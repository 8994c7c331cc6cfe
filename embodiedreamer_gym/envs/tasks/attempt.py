"""Progress of an episode, computed from its situations, in the same way for every engine."""

from __future__ import annotations

from typing import Any

import numpy as np

from embodiedreamer_gym.envs.tasks.task import Situation, Task
from embodiedreamer_gym.geometry.pose import length


class Attempt:
    """One episode of a task: whether its object has been picked up, and how near the gripper came to it before.

    grasped: whether it has been picked up at any time; nearest: smallest distance of the end effector from where it
    grips the object, m, 0 once the object has been picked up.
    """

    def __init__(self, task: Task) -> None:
        self.task, self.grasped, self.nearest = task, False, np.inf

    def see(self, now: Situation) -> None:
        """Update with the situation at the next instant."""
        if self.grasped:
            return
        self.grasped = bool(self.task.picked_up(now))
        gap = length(now.tip.position - self.task.handle(now))
        self.nearest = 0.0 if self.grasped else min(self.nearest, gap)

    def info(self, now: Situation, target: np.ndarray, seconds: float) -> dict[str, Any]:
        """Entries of `info` for a situation that `see` has processed; keys and types never change.

        target (3,): the task's target of the end effector in this situation, m; seconds: since the reset.
        """
        done = bool(self.grasped and self.task.done(now))
        off = length(now.object.position - now.goal.position)
        return {
            "is_success": done,
            "task_success": done,
            "grasp_success": self.grasped,
            "distance": length(now.tip.position - target),
            "object_distance": off,
            "remaining": 0.0 if done else self.nearest + off,
            "contacts": int(now.fingers),
            "sim_time": seconds,
            "side": now.side,
        }
