"""Losses of trajectory-wise preference optimisation, on the log-likelihoods of pairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch.nn.functional import logsigmoid

from embodiedreamer_gym.errors import PolicyError


@dataclass(frozen=True)
class LossConfig:
    """Which loss, and its constants.

    Raises: PolicyError for an unknown variant, or constants that are not above zero.
    """

    variant: str = "clipped+dpop"
    """A name in VARIANTS; the default prevents the winners' likelihood from falling along with the losers'."""
    beta: float = 0.1
    """Weight of a pair in the sigmoid (the paper's); tau in `ipo`."""
    penalty: float = 5.0
    """Lambda of DPOP: weight of a winner's fall below the reference."""
    imitation: float = 1.0
    """Weight of the winner's own likelihood in `nll`."""
    clip: float = 1.0
    """Nats below the reference at which the loser's log-likelihood is clipped."""

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise PolicyError(f"loss variant '{self.variant}' is not one of {', '.join(VARIANTS)}.")
        for name in ("beta", "penalty", "imitation", "clip"):
            if not getattr(self, name) > 0:
                raise PolicyError(f"{name} of the loss is {getattr(self, name)}, but must be above 0.")


def tpo_loss(
    winner: torch.Tensor, loser: torch.Tensor, reference_winner: torch.Tensor, reference_loser: torch.Tensor,
    config: LossConfig | None = None,
) -> torch.Tensor:  # fmt: skip
    """Mean loss over pairs, from log-likelihoods (n,) of the winners and the losers under the policy and its reference.

    paper: -log sigma(beta (w - l)) with w, l the policy's log-likelihood minus the reference's (`eqn:tpo_custom`, which
    is DPO, Rafailov et al. 2023, equation 7, summed over a trajectory as in GRAPE). ipo, nll, dpop and clipped are
    below, and clipped+dpop, the default, combines clipped and dpop.
    Raises: PolicyError if the four do not have the same shape (n,).
    """
    config = config or LossConfig()
    shapes = {tuple(t.shape) for t in (winner, loser, reference_winner, reference_loser)}
    if len(shapes) > 1 or winner.ndim != 1 or not len(winner):
        raise PolicyError(f"tpo_loss needs four log-likelihoods (n,) of n pairs, not shapes {sorted(shapes)}.")
    return VARIANTS[config.variant](winner, winner - reference_winner, loser - reference_loser, config).mean()


Variant = Callable[[torch.Tensor, torch.Tensor, torch.Tensor, LossConfig], torch.Tensor]


def _paper(likelihood: torch.Tensor, won: torch.Tensor, lost: torch.Tensor, config: LossConfig) -> torch.Tensor:
    """-log sigma(beta (w - l)): l can fall without limit, and w along with it."""
    return -logsigmoid(config.beta * (won - lost))


def _ipo(likelihood: torch.Tensor, won: torch.Tensor, lost: torch.Tensor, config: LossConfig) -> torch.Tensor:
    """((w - l) - 1 / (2 tau))^2: a gap to reach, not to widen forever (Azar et al. 2023, arXiv 2310.12036)."""
    return (won - lost - 0.5 / config.beta).square()


def _nll(likelihood: torch.Tensor, won: torch.Tensor, lost: torch.Tensor, config: LossConfig) -> torch.Tensor:
    """The paper's, minus the winner's own likelihood (Pang et al. 2024, arXiv 2404.19733; there per length)."""
    return _paper(likelihood, won, lost, config) - config.imitation * likelihood


def _dpop(likelihood: torch.Tensor, won: torch.Tensor, lost: torch.Tensor, config: LossConfig) -> torch.Tensor:
    """-log sigma(beta (w - l - lambda max(0, -w))): penalises a winner's fall (Pal et al. 2024, Smaug, equation 3)."""
    return -logsigmoid(config.beta * (won - lost - config.penalty * (-won).clamp(min=0)))


def _clipped(likelihood: torch.Tensor, won: torch.Tensor, lost: torch.Tensor, config: LossConfig) -> torch.Tensor:
    """-log sigma(beta (w - max(l, -c))): a loser is not pushed further than c nats below the reference."""
    return _paper(likelihood, won, lost.clamp(min=-config.clip), config)


def _clipped_dpop(likelihood: torch.Tensor, won: torch.Tensor, lost: torch.Tensor, config: LossConfig) -> torch.Tensor:
    """Clipped and DPOP together: losers are not pushed below the clip, and a winner's fall is penalised."""
    return _dpop(likelihood, won, lost.clamp(min=-config.clip), config)


VARIANTS: dict[str, Variant] = {
    "paper": _paper, "ipo": _ipo, "nll": _nll, "dpop": _dpop, "clipped": _clipped, "clipped+dpop": _clipped_dpop,
}  # fmt: skip
