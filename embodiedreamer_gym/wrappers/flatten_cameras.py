"""Cameras as keys of a flat dictionary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from gymnasium import spaces

from embodiedreamer_gym.errors import SimulationError


class FlattenCameras(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Turns {"pixels": {"head": ...}, "agent_pos": ...} into {"pixels_head": ..., "agent_pos": ...}.

    Stable-Baselines3 takes flat dictionaries only; LeRobot wants the nested ones.
    Raises: SimulationError for observations that are no dictionary.
    """

    def __init__(self, env: gym.Env) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        gym.ObservationWrapper.__init__(self, env)
        if not isinstance(env.observation_space, spaces.Dict):
            raise SimulationError(
                "FlattenCameras needs observations that are dictionaries, not a "
                f"{type(env.observation_space).__name__}; make the environment with several cameras, or leave the "
                "wrapper out."
            )
        self.observation_space = spaces.Dict(_flat(env.observation_space))

    def observation(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The same arrays in one dictionary."""
        return _flat(observation)


def _flat(nested: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Leaves of nested mappings, by their joined names."""
    leaves: dict[str, Any] = {}
    for name, value in nested.items():
        leaves |= _flat(value, f"{prefix}{name}_") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return leaves
