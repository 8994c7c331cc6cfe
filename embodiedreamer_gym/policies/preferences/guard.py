"""Stops fine-tuning that destroys the policy, and restores the last good weights."""

from __future__ import annotations

import copy
import warnings

from embodiedreamer_gym.policies.preferences.likelihood import ChunkNetwork

STILL = (
    1e-4  # norm of the gradient: up to 1.2e-5 on noiseless rollouts, 0.4 to 5 on noisy ones (benchmarks/preferences)
)
FALL = 5.0  # nats below the reference; with the default loss, the winners stay above this


class NoGradientWarning(UserWarning):
    """The loss has no gradient at the start: the trajectories are the policy's own, without exploration noise."""


class Guard:
    """Checks the winners' mean log-likelihood after each epoch.

    fall: nats by which it may lie below the reference's; None for no check.
    """

    def __init__(self, network: ChunkNetwork, fall: float | None = FALL) -> None:
        self.network, self.fall = network, fall
        self._good = copy.deepcopy(network.state_dict()) if fall is not None else None

    def passes(self, winners: float) -> bool:
        """Keep the weights as good; if the winners have fallen too far, restore the last good ones and return False.

        winners: their mean log-likelihood minus the reference's, nats.
        """
        if self.fall is None or self._good is None:
            return True
        if winners >= -self.fall:  # False for NaN too
            self._good = copy.deepcopy(self.network.state_dict())
            return True
        self.network.load_state_dict(self._good)
        return False


def warn_if_still(gradient: float, error: float) -> None:
    """Warn if the loss cannot change the policy.

    gradient: norm at the start; error: the largest norm of a^ - a over a chunk, normalised.
    """
    if gradient < STILL:
        warnings.warn(
            f"the preference loss has no gradient at the start ({gradient:.1e}; actions differ from the policy's by at "
            f"most {error:.1e}): these are the policy's own rollouts without exploration noise; roll out with noise.",
            NoGradientWarning,
            stacklevel=3,
        )
