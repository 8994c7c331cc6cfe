"""Simulated frames become real-looking ones, chunk by chunk."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.vis_aligner import Aligner, Bank, Condition, References, load_aligner, load_bank
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk


class VisAlignerObservationWrapper(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Gives the head camera's pictures a real face; reward and physics stay as they are.

    Put it around an `ActionChunk`; without one, it puts one of the aligner's chunk there itself, so that the action is
    (k, 14). After each chunk info["frames"] holds the k dreamed frames (k, H, W, 3) uint8, of which the observation shows
    the last; it is the reference of the next chunk, beside the anchor, the first frame of the episode. At a reset the
    reference is painted from photos of a bench: an empty plate, and the objects put in where the simulator has them; or,
    with `reset(options={"reference": i})`, photo i itself, to whose joints and objects the simulator is set.
    Wrist cameras are not dreamed, and are left out of the observation.

    aligner: "lean" (the shipped weights), or a path; bank: "lab" (the shipped photos), or a path; chunk: actions of a
    chunk, the aligner's own where None.
    Raises: VisionError where weights, photos and picture size do not fit; SimulationError for observations without
    pictures.
    """

    def __init__(self, env: gym.Env, aligner: str = "lean", bank: str = "lab", chunk: int | None = None) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, aligner=aligner, bank=bank, chunk=chunk)
        self.aligner: Aligner = load_aligner(aligner)
        self.bank: Bank = load_bank(bank)
        _check_pictures(env)
        inner = _chunk_of(env)
        if inner is None:
            env = inner = ActionChunk(env, chunk or self.aligner.chunk, camera="head", size=self.bank.size)
        elif inner.camera != "head" or (inner.size or env.unwrapped.image_size) != self.bank.size:  # pyright: ignore[reportAttributeAccessIssue]
            raise VisionError(
                f"the bank's photos are {self.bank.size[0]} x {self.bank.size[1]} of the head camera; "
                f'wrap with ActionChunk(env, k, camera="head", size={self.bank.size}), or leave ActionChunk out.'
            )
        gym.Wrapper.__init__(self, env)
        width, height = self.bank.size
        self._picture = spaces.Box(0, 255, (height, width, 3), np.uint8)
        self.observation_space = self._space(env.observation_space)
        self.references: References | None = None
        self._shown: np.ndarray | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; options: those of the environment, and reference: number of a photo of the bank."""
        options = dict(options or {})
        number = options.pop("reference", None)
        entry = None if number is None else self.bank.entry(number)
        if entry is not None:
            options |= entry.options()
        observation, info = self.env.reset(seed=seed, options=options or None)
        condition = _condition(info["clip"])
        frame = entry.frame if entry is not None else self.bank.paint(condition)
        self.references = References.start(frame, condition)
        return self._seen(observation, frame), self._told(info, frame[None])

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Play a chunk of actions and dream what the camera would have shown."""
        if self.references is None:
            raise gym.error.ResetNeeded("call reset before the first step.")
        observation, reward, terminated, truncated, info = self.env.step(action)
        condition = _condition(info["clip"])
        frames = self.aligner.render([self.references], [condition])[0]
        self.references = self.references.after(frames, condition)
        return self._seen(observation, frames[-1]), float(reward), terminated, truncated, self._told(info, frames)

    def render(self) -> Any:
        """The last dreamed frame (H, W, 3), where the environment renders at all."""
        return None if self.render_mode is None else self._shown

    # ---- inside ------------------------------------------------------------------------------------------------

    def _space(self, space: spaces.Space) -> spaces.Space:
        if isinstance(space, spaces.Dict) and "pixels" in space.spaces:
            return spaces.Dict({**space.spaces, "pixels": self._picture})
        return self._picture

    def _seen(self, observation: Any, frame: np.ndarray) -> Any:
        self._shown = frame
        if isinstance(self.observation_space, spaces.Dict):
            return {**observation, "pixels": frame}
        return frame

    def _told(self, info: dict[str, Any], frames: np.ndarray) -> dict[str, Any]:
        return {key: value for key, value in info.items() if key != "clip"} | {"frames": frames}


def _condition(clip: dict[str, np.ndarray]) -> Condition:
    return Condition(clip["rgb"], clip["classes"], clip["depth"])


def _chunk_of(env: gym.Env) -> ActionChunk | None:
    """The ActionChunk in a stack of wrappers."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, ActionChunk):
            return env
        env = env.env
    return None


def _check_pictures(env: gym.Env) -> None:
    """Raise SimulationError for an environment whose observations show nothing."""
    kind = getattr(env.unwrapped, "obs_type", None)
    if kind not in ("pixels", "pixels_agent_pos"):
        raise SimulationError(
            f"VisAlignerObservationWrapper dreams pictures, and obs_type {kind!r} has none; "
            "make the environment with obs_type='pixels_agent_pos' or 'pixels'."
        )
