"""The environments, and their names in Gymnasium."""

from __future__ import annotations

import gymnasium as gym

from embodiedreamer_gym.errors import EmbodieDreamerError

NAMES = ("GrabPaperCup", "PutPenInCup", "PutRemoteInBox", "PutCupOnMat")
STEPS = 300


def register_envs() -> None:
    """Register EmbodieDreamer/<task>-v0 and EmbodieDreamer/<task>Goal-v0 with Gymnasium; nothing is imported yet."""
    for name in NAMES:
        for suffix, entry in (("", "aloha:AlohaEnv"), ("Goal", "goal:AlohaGoalEnv")):
            gym.register(f"EmbodieDreamer/{name}{suffix}-v0", f"embodiedreamer_gym.envs.{entry}",
                         max_episode_steps=STEPS, kwargs={"task": name})  # fmt: skip


def task_name(text: str) -> str:
    """A task's name, from its name or Gymnasium id."""
    return text.removeprefix("EmbodieDreamer/").removesuffix("-v0")


def task_id(text: str) -> str:
    """A task's Gymnasium id, from its id or name.

    Raises: EmbodieDreamerError for an unknown task.
    """
    name = task_name(text)
    if name not in NAMES:
        raise EmbodieDreamerError(f"there is no task '{text}'; give one of {', '.join(NAMES)}.")
    return f"EmbodieDreamer/{name}-v0"
