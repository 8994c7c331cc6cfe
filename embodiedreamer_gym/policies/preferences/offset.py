"""A constant offset of all actions, estimated from the exploration noise of pairs of rollouts."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences.preference_set import PreferenceSet


def preferred_offset(pairs: PreferenceSet) -> np.ndarray:
    """Half the mean difference (m,) between the exploration noise of winners and losers, in the environment's units.

    The noise of a trajectory is averaged over its played actions. Winner and loser start from the same scene, so this
    is an estimate of the direction in which a constant offset improves the metric.
    Source: Salimans et al., Evolution Strategies as a Scalable Alternative to Reinforcement Learning, 2017.
    """
    noise = [
        [(one.actions - one.means)[one.played].mean(axis=0) for one in side] for side in (pairs.winners, pairs.losers)
    ]
    return 0.5 * (np.array(noise[0]) - np.array(noise[1])).mean(axis=0)


def shift_actions(network: Any, offset: np.ndarray) -> None:
    """Add an offset (m,), in the environment's units, to all actions of a network, in place.

    Raises: PolicyError for a network whose actions are not normalised with a buffer `action_mean` (m,).
    """
    mean = getattr(network, "action_mean", None)
    if not isinstance(mean, torch.Tensor) or tuple(mean.shape) != np.shape(offset):
        raise PolicyError("an offset can be added only to a network that normalises its actions with `action_mean`.")
    mean.add_(torch.as_tensor(offset, dtype=mean.dtype, device=mean.device))
