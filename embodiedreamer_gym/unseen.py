"""Pictures that nobody looks at need not be drawn: they take more time than the physics between them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, RecordEpisodeStatistics, TimeLimit

EVERY = 5  # actions between dreamed frames of a chunk, of which a policy looks at the last one alone
PASSING = (OrderEnforcing, PassiveEnvChecker, RecordEpisodeStatistics, TimeLimit)  # observations as they are


def see_through(env: gym.Env) -> Any:
    """The environment at the bottom, where it can be `blind` and no wrapper on the way may look at observations; or None."""
    while isinstance(env, gym.Wrapper):
        if type(env) not in PASSING:
            return None
        env = env.env
    return env if hasattr(env, "blind") else None


@contextmanager
def unseen(world: Any, now: bool = True) -> Iterator[None]:
    """Within, what `see_through` found draws no pictures."""
    if world is None or not now:
        yield
        return
    world.blind = True
    try:
        yield
    finally:
        world.blind = False
