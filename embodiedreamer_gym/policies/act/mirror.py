"""Demonstrations seen in a mirror: the other arm does the same on the other side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.samples import Sample


class Mirror:
    """Mirrors some of a batch's starts, for a rig whose arms and cameras are symmetric in a plane.

    numbers (n,): joint numbers, counted from 1, with a sign, as `embodiedreamer_gym.robot.mirror.mirrored_joints` gives
    them; states and actions are of the same joints. A camera that looks along the plane sees its own picture flipped, and
    left_NAME sees that of right_NAME.
    Raises: PolicyError for numbers that are no mirror, or cameras without their counterpart.
    """

    def __init__(self, numbers: Sequence[int], cameras: Sequence[str]) -> None:
        found = np.array(numbers, int)
        self.index, self.sign = np.abs(found) - 1, np.sign(found).astype(np.float32)
        count = np.arange(len(found))
        if sorted(self.index) != list(count) or (self.index[self.index] != count).any():
            raise PolicyError(f"{list(numbers)} is no mirror: each joint is the image of its own image.")
        self.other = {name: _counterpart(name) for name in cameras}
        for name, other in self.other.items():
            if other not in cameras:
                raise PolicyError(f"the camera '{name}' cannot be mirrored without '{other}'; take both, or no mirror.")

    def __call__(self, sample: Sample, which: np.ndarray) -> Sample:
        """The sample with the starts (B,) that are True mirrored."""
        states, actions, pixels = sample.batch["agent_pos"].copy(), sample.actions.copy(), sample.batch["pixels"]
        states[which] = self.joints(states[which])
        actions[which] = self.joints(actions[which])
        return Sample({"agent_pos": states, "pixels": self._seen(pixels, which)}, actions, sample.padding)

    def joints(self, values: np.ndarray) -> np.ndarray:
        """Joint values (..., n) of the mirrored robot."""
        return values[..., self.index] * self.sign

    def _seen(self, pixels: Mapping[str, np.ndarray], which: np.ndarray) -> dict[str, np.ndarray]:
        """What the cameras of the mirrored scene see."""
        flipped = {name: pixels[name].copy() for name in pixels}
        for name, other in self.other.items():
            flipped[name][which] = pixels[other][which, :, ::-1]
        return flipped


def _counterpart(name: str) -> str:
    for one, other in (("left", "right"), ("right", "left")):
        if one in name:
            return name.replace(one, other)
    return name
