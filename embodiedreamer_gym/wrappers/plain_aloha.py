"""The ALOHA environment below Gymnasium's own wrappers."""

from __future__ import annotations

import gymnasium as gym

from embodiedreamer_gym.envs.aloha import AlohaEnv


def plain_aloha(env: gym.Env) -> AlohaEnv | None:
    """The ALOHA environment below the wrappers that `gym.make` adds; None for another wrapper or environment."""
    wrapped = isinstance(env, gym.Wrapper) and (env.spec is None or bool(env.spec.additional_wrappers))
    return env.unwrapped if isinstance(env.unwrapped, AlohaEnv) and not wrapped else None
