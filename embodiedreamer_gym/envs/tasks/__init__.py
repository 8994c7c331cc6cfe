"""The tasks, one file each; a new task needs a file and an entry in TASKS."""

from __future__ import annotations

from embodiedreamer_gym.envs.tasks.grab_paper_cup import GrabPaperCup
from embodiedreamer_gym.envs.tasks.put_cup_on_mat import PutCupOnMat
from embodiedreamer_gym.envs.tasks.put_pen_in_cup import PutPenInCup
from embodiedreamer_gym.envs.tasks.put_remote_in_box import PutRemoteInBox
from embodiedreamer_gym.envs.tasks.task import Task

TASKS: dict[str, type[Task]] = {
    task.__name__: task for task in (GrabPaperCup, PutPenInCup, PutRemoteInBox, PutCupOnMat)
}

__all__ = ["TASKS", "Task"]
