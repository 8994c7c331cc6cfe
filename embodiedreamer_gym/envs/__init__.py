"""The environments, and their names in Gymnasium."""

from __future__ import annotations

import gymnasium as gym

from embodiedreamer_gym.errors import EmbodieDreamerError

NAMES = ("GrabPaperCup", "PutPenInCup", "PutRemoteInBox", "PutCupOnMat")
STEPS = 300


def register_envs() -> None:
    """Tell Gymnasium the ids, EmbodieDreamer/<task>-v0 and EmbodieDreamer/<task>Goal-v0; nothing is loaded yet."""
    for name in NAMES:
        for suffix, entry in (("", "aloha:AlohaEnv"), ("Goal", "goal:AlohaGoalEnv")):
            gym.register(f"EmbodieDreamer/{name}{suffix}-v0", f"embodiedreamer_gym.envs.{entry}",
                         max_episode_steps=STEPS, kwargs={"task": name})  # fmt: skip


def task_name(text: str) -> str:
    """A task's name, given by that or by Gymnasium's id."""
    return text.removeprefix("EmbodieDreamer/").removesuffix("-v0")


def task_id(text: str) -> str:
    """Gymnasium's id of a task, given by id or by name.

    Raises: EmbodieDreamerError for a task that there is not.
    """
    name = task_name(text)
    if name not in NAMES:
        raise EmbodieDreamerError(f"there is no task '{text}'; there are {', '.join(NAMES)}.")
    return f"EmbodieDreamer/{name}-v0"
