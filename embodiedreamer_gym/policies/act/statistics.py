"""Means and scales for normalising states, actions and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.config import ActConfig

LEAST = 1e-2  # rad, or share of a gripper's stroke: smaller motions are not amplified; upstream clips here too
PIXEL_MEAN, PIXEL_SCALE = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, as pretrained weights expect
NAMES = ("state_mean", "state_scale", "action_mean", "action_scale", "pixel_mean", "pixel_scale")


@dataclass(frozen=True, eq=False)
class Statistics:
    """Means and scales: of states (n,), actions (m,), and of each camera's colours (cameras, 3) of 0 .. 1."""

    state_mean: torch.Tensor
    state_scale: torch.Tensor
    action_mean: torch.Tensor
    action_scale: torch.Tensor
    pixel_mean: torch.Tensor
    pixel_scale: torch.Tensor

    def __repr__(self) -> str:
        return f"Statistics(states {len(self.state_mean)}, actions {len(self.action_mean)})"

    @staticmethod
    def neutral(c: ActConfig) -> Statistics:
        """Means 0 and scales 1; ImageNet's for pictures."""
        return Statistics(torch.zeros(c.state_size), torch.ones(c.state_size), torch.zeros(c.action_size),
                          torch.ones(c.action_size), *_imagenet(len(c.cameras)))  # fmt: skip

    @staticmethod
    def measure(states: Sequence[np.ndarray], actions: Sequence[np.ndarray], cameras: int) -> Statistics:
        """Measure them over all steps of episodes; states (T, n) and actions (T, m) of each episode."""
        return Statistics(*_moments(np.concatenate(states)), *_moments(np.concatenate(actions)), *_imagenet(cameras))

    def register(self, module: nn.Module) -> None:
        """Register them as buffers of a module, which then saves, loads and moves them.

        Raises: PolicyError for one that is not finite, or a scale that is not positive.
        """
        for name in NAMES:
            value = getattr(self, name).detach().clone().float()
            if not bool(torch.isfinite(value).all()) or ("scale" in name and not bool((value > 0).all())):
                raise PolicyError(f"{name} of the policy's statistics must be finite, and scales must be positive.")
            module.register_buffer(name, value)

    @staticmethod
    def of(state: Mapping[str, Any]) -> Statistics:
        """Get the statistics from a module's saved weights.

        Raises: PolicyError if one is missing.
        """
        for name in NAMES:
            if not isinstance(state.get(name), torch.Tensor):
                raise PolicyError(f"the weights have no '{name}'; they do not belong to an ACT policy of this package.")
        return Statistics(**{name: state[name] for name in NAMES})


def _moments(values: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean and scale of values (T, n)."""
    scale = np.maximum(values.std(0, dtype=np.float64), LEAST)
    return torch.from_numpy(values.mean(0, dtype=np.float64)).float(), torch.from_numpy(scale).float()


def _imagenet(cameras: int) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.tensor(PIXEL_MEAN).repeat(cameras, 1), torch.tensor(PIXEL_SCALE).repeat(cameras, 1)
