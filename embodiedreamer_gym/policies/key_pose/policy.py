"""Key poses as a policy: it plans once from the first pictures of an episode, and returns joint positions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.key_pose.arms import Arms
from embodiedreamer_gym.policies.key_pose.frames import Scene, mirrored
from embodiedreamer_gym.policies.key_pose.motion import plan
from embodiedreamer_gym.policies.key_pose.skill import Skill
from embodiedreamer_gym.robot import RobotModel

CHUNK = 300  # actions
Look = Callable[[Mapping[str, np.ndarray]], Scene | None]  # pictures of one observation -> objects on the table


class KeyPosePolicy:
    """Positions (B, 300, n) of the joints for a batch {"agent_pos": (B, n), "pixels": {camera: (B, H, W, 3) uint8}}.

    It plans the whole motion at the first call after `reset`; later calls return what follows the last chunk. Its
    actions are target joint `positions`, not commands: `CalibratedTracking` converts them to commands. If an object is
    not seen, or no motion is found, the arm does not move.
    """

    positions = True
    chunk = CHUNK

    def __init__(self, skill: Skill, model: RobotModel, look: Look, hz: float, cameras: tuple[str, ...] = ("head",),
                 picture_size: tuple[int, int] = (128, 96)) -> None:  # fmt: skip
        self.skill, self.arms, self.look, self.hz, self.cameras = skill, Arms(model), look, hz, cameras
        self.action_size, self.picture_size = model.n, picture_size
        self._plans: list[np.ndarray] = []
        self._played = 0

    def __repr__(self) -> str:
        return f"KeyPosePolicy({len(self.skill.keys)} key poses, {len(self.skill.scenes)} demonstrations)"

    def reset(self) -> None:
        """Discard the plan at the start of an episode."""
        self._plans, self._played = [], 0

    def __call__(self, batch: Mapping[str, Any]) -> np.ndarray:
        """Positions (B, 300, n) float32.

        Raises: PolicyError for observations of other joints.
        """
        states = np.asarray(batch["agent_pos"], float)
        if states.ndim != 2 or states.shape[1] != self.action_size:
            raise PolicyError(
                f"the key poses have {self.action_size} joints, but the observations have the shape {states.shape}."
            )
        if len(self._plans) != len(states):
            pictures = [{name: x[i] for name, x in batch.get("pixels", {}).items()} for i in range(len(states))]
            self._plans = [self._planned(state, self.look(seen)) for state, seen in zip(states, pictures, strict=True)]
            self._played = 0
        first, self._played = self._played, self._played + self.chunk
        rows = [one[np.minimum(np.arange(first, first + self.chunk), len(one) - 1)] for one in self._plans]
        return np.array(rows, np.float32)

    def _planned(self, state: np.ndarray, scene: Scene | None) -> np.ndarray:
        """Positions (T, n) of an episode that begins at a state (n,)."""
        arms, still = self.arms, state[None]
        if scene is None or self.skill.side not in scene:
            return still
        other = arms.two and scene[self.skill.side][1] < 0
        start = arms.mirrored(state) if other else state
        found = plan(self.skill, mirrored(scene) if other else scene, arms.arm, start[arms.arm.joints], self.hz)
        if found is None:
            return still
        way = np.repeat(start[None], len(found[0]), axis=0)
        way[:, arms.arm.joints], way[:, arms.gripper] = found
        return arms.mirrored(way) if other else way
