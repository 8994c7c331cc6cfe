"""The environments, and their names in Gymnasium."""

from __future__ import annotations

import gymnasium as gym

NAMES = ("GrabPaperCup", "PutPenInCup", "PutRemoteInBox", "PutCupOnMat")
STEPS = 300


def register_envs() -> None:
    """Tell Gymnasium the ids, EmbodieDreamer/<task>-v0 and EmbodieDreamer/<task>Goal-v0; nothing is loaded yet."""
    for name in NAMES:
        for suffix, entry in (("", "aloha:AlohaEnv"), ("Goal", "goal:AlohaGoalEnv")):
            gym.register(f"EmbodieDreamer/{name}{suffix}-v0", f"embodiedreamer_gym.envs.{entry}",
                         max_episode_steps=STEPS, kwargs={"task": name})  # fmt: skip
