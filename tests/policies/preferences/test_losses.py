"""The losses by hand: where their gradients point, and where they stop."""

from __future__ import annotations

import math

import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import VARIANTS, LossConfig, tpo_loss

ZERO = torch.zeros(1)


def value(variant: str, won: float, lost: float, **constants: float) -> tuple[float, float, float]:
    """Loss, and its slopes with the winner's and the loser's log-likelihood; the reference's are 0."""
    w, l = torch.tensor([won], requires_grad=True), torch.tensor([lost], requires_grad=True)
    loss = tpo_loss(w, l, ZERO, ZERO, LossConfig(variant, **constants))
    slopes = torch.autograd.grad(loss, (w, l), allow_unused=True)
    return loss.item(), *(0.0 if s is None else s.item() for s in slopes)


def test_the_papers_loss_is_its_equation() -> None:
    w, l, rw, rl = (torch.tensor(x) for x in ([-3.0, -1.0], [-2.0, -9.0], [-2.5, -4.0], [-6.0, -2.0]))
    beta, expected = 0.3, 0.0
    for i in range(2):
        gap = (w[i] - rw[i]) - (l[i] - rl[i])
        expected -= 0.5 * math.log(1 / (1 + math.exp(-beta * gap.item())))
    assert tpo_loss(w, l, rw, rl, LossConfig("paper", beta)).item() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("variant", ["paper", "dpop", "clipped", "clipped+dpop"])
def test_at_the_reference_it_is_log_2(variant: str) -> None:
    assert value(variant, 0.0, 0.0)[0] == pytest.approx(math.log(2))


def test_the_papers_loss_falls_with_a_falling_winner() -> None:
    """Which is how it collapses: both fall, the loser further."""
    near, far = value("paper", -10.0, -30.0), value("paper", -500.0, -900.0)
    assert far[0] < near[0] < math.log(2)
    assert near[2] > 0, "and pushes the loser on"


@pytest.mark.parametrize("variant", ["dpop", "clipped+dpop"])
def test_dpop_holds_the_winner(variant: str) -> None:
    assert value(variant, -10.0, -30.0)[0] > math.log(2)
    rise = value("paper", 0.5, -0.5)
    assert value(variant, 0.5, -0.5) == pytest.approx(rise), "a winner that rose pays nothing"
    assert value(variant, -1.0, 0.0, penalty=5.0)[0] == pytest.approx(-math.log(1 / (1 + math.exp(0.1 * 6))), rel=1e-5)


@pytest.mark.parametrize("variant", ["clipped", "clipped+dpop"])
def test_a_clipped_loser_is_left_alone(variant: str) -> None:
    assert value(variant, 0.2, -1.5, clip=1.0)[2] == 0.0
    assert value(variant, 0.2, -1.5, clip=1.0)[1] < 0, "the winner goes on"
    assert value(variant, 0.2, -1.5, clip=2.0)[2] > 0


def test_ipo_has_a_gap_to_reach() -> None:
    for won, lost in ((5.0, 0.0), (1.0, -4.0)):
        assert value("ipo", won, lost, beta=0.1) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert value("ipo", 8.0, 0.0)[1] > 0, "beyond it, it pulls back"


def test_nll_adds_the_winners_own_likelihood() -> None:
    likelihood, reference = torch.tensor([-3.0]), torch.tensor([-2.0])
    paper, nll = (tpo_loss(likelihood, ZERO, reference, ZERO, LossConfig(v, imitation=0.5)) for v in ("paper", "nll"))
    assert (nll - paper).item() == pytest.approx(1.5)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_prefers_the_winner(variant: str) -> None:
    _, winner, loser = value(variant, 0.1, -0.1)
    assert winner < 0 < loser


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"variant": "dpo"}, "'dpo' is not one of paper, ipo, nll, dpop, clipped, clipped"),
        ({"beta": 0.0}, "beta of the loss is 0.0"),
        ({"clip": -1.0}, "clip of the loss is -1.0"),
        ({"penalty": float("nan")}, "penalty of the loss is nan"),
    ],
)
def test_constants_are_checked(change, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        LossConfig(**change)


def test_other_shapes_are_refused() -> None:
    for bad in (torch.zeros(2), torch.zeros(1, 1)):
        with pytest.raises(PolicyError, match=r"four log-likelihoods \(n,\)"):
            tpo_loss(ZERO, bad, ZERO, ZERO)
    with pytest.raises(PolicyError, match="four log-likelihoods"):
        tpo_loss(*[torch.zeros(0)] * 4)
