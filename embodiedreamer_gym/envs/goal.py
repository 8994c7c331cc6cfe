"""The goal variant of the ALOHA environment, for hindsight experience replay."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.arguments import check_choice
from embodiedreamer_gym.envs.observations import REACH
from embodiedreamer_gym.envs.tasks.task import Situation


class AlohaGoalEnv(AlohaEnv):
    """An ALOHA environment whose observation is a dictionary of state, achieved goal and desired goal.

    achieved_goal (3,): the acting arm's end effector, m; desired_goal (3,): the task's target. Arguments: those of
    AlohaEnv, with obs_type state.
    """

    def __init__(self, task: str = "PutCupOnMat", obs_type: str = "state", **arguments: Any) -> None:
        check_choice("obs_type of a goal environment", obs_type, ("state",))
        super().__init__(task, obs_type=obs_type, **arguments)
        self._ezpickle_args, self._ezpickle_kwargs = (task,), arguments

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """Minus the distance (...,) between achieved and desired goals (..., 3), m; info is not used."""
        return -np.linalg.norm(np.asarray(achieved_goal) - np.asarray(desired_goal), axis=-1)

    def step(self, action: np.ndarray, *, render: bool = True) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive the joints to their targets (14,) for one control period."""
        observation, _, terminated, truncated, info = super().step(action, render=render)
        reward = float(self.compute_reward(observation["achieved_goal"], observation["desired_goal"], info))
        return observation, reward, terminated, truncated, info

    def _space(self) -> spaces.Space:
        place = spaces.Box(-REACH, REACH, (3,), np.float64)
        return spaces.Dict({"observation": self._state_space, "achieved_goal": place, "desired_goal": place})

    def _assemble(self, position: np.ndarray, velocity: np.ndarray, now: Situation, target: np.ndarray) -> Any:
        state = super()._assemble(position, velocity, now, target)
        return {
            "observation": state,
            "achieved_goal": np.clip(now.tip.position, -REACH, REACH),
            "desired_goal": np.clip(target, -REACH, REACH),
        }
