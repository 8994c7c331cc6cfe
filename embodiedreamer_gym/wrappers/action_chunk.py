"""A chunk of actions as one action."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from embodiedreamer_gym.engines.bullet.rendering import Frame, stacked
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.unseen import see_through, unseen


class ActionChunk(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Takes k actions (k, 14) at once, as policies that predict chunks give them, and plays them one after the other.

    The reward is the sum of the k rewards, observation and info are those after the last action; info["rewards"] (k,)
    holds each reward and info["steps"] their number, which is less than k where the episode was cut, and 0 after a reset.
    With `camera`, info["clip"] holds what it saw after every n-th action and the last, F = ceil(k / every) times: rgb
    (F, H, W, 3) uint8, depth (F, H, W) m and classes (F, H, W), and what is rigid: parts (F, H, W), projections
    (F, L, 3, 4), see `Frame`; info["filmed"] is how often it did, 0 after a reset. What is not there repeats the last
    instant (of rewards: is 0), so that shapes never change.

    camera: name of a camera, or None; size: its picture's width and height, the environment's own where None; every: n.
    Raises: SimulationError for k or n below 1, an action space that is no box, or a camera without an ALOHA environment.
    """

    def __init__(
        self, env: gym.Env, k: int = 8, camera: str | None = None, size: tuple[int, int] | None = None, every: int = 1
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, k=k, camera=camera, size=size, every=every)
        gym.Wrapper.__init__(self, env)
        for text, count in (("a chunk has k = 1 or more actions", k), ("the camera films every n = 1 or more", every)):
            if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
                raise SimulationError(f"{text}, not {count!r}.")
        one = env.action_space
        if not isinstance(one, spaces.Box):
            raise SimulationError(f"ActionChunk takes actions that are arrays, not a {type(one).__name__}.")
        if camera is not None and not isinstance(env.unwrapped, AlohaEnv):
            raise SimulationError(f"only ALOHA environments have a camera '{camera}'; leave it out.")
        self.k, self.every, self.camera = int(k), int(every), camera
        self.size = None if size is None else (int(size[0]), int(size[1]))
        low, high = (np.repeat(bound[None], self.k, axis=0) for bound in (one.low, one.high))
        self.action_space = spaces.Box(low, high, dtype=one.dtype.type)  # pyright: ignore[reportArgumentType, reportOptionalMemberAccess]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; with a camera, info["clip"] is its view of this instant."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info | self._told([], [self._look()])

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Play the actions (k, n), up to where the episode ends.

        Raises: ValueError for another shape.
        """
        action = np.asarray(action)
        if action.shape != self.action_space.shape:
            raise ValueError(f"a chunk has shape {self.action_space.shape}, not {action.shape}.")
        rewards, looks = [], []
        observation, info, terminated, truncated = None, {}, False, False
        world = see_through(self.env)
        for number, one in enumerate(action, 1):
            with unseen(world, number < len(action)):  # only the last observation is shown
                observation, reward, terminated, truncated, info = self.env.step(one)
            rewards.append(float(reward))
            over = terminated or truncated
            if over or number == len(action) or number % self.every == 0:
                looks.append(self._look())
            if over:
                observation = observation if world is None or number == len(action) else world.observe()
                break
        return observation, float(sum(rewards)), terminated, truncated, info | self._told(rewards, looks)

    def _look(self) -> Frame | None:
        """What the camera sees at this instant; nothing without a camera."""
        aloha = self.env.unwrapped
        if self.camera is None or not isinstance(aloha, AlohaEnv):
            return None
        return aloha.capture(self.camera, self.size)

    def _told(self, rewards: list[float], looks: list[Frame | None]) -> dict[str, Any]:
        """What info says of a chunk."""
        told: dict[str, Any] = {
            "rewards": np.pad(np.array(rewards, float), (0, self.k - len(rewards))),
            "steps": len(rewards),
        }
        if self.camera is not None:
            seen = [look for look in looks if look is not None]
            told["clip"] = stacked(seen + seen[-1:] * (-(-self.k // self.every) - len(seen)))
            told["filmed"] = len(seen) if rewards else 0
        return told
