"""The guard, and the warning."""

from __future__ import annotations

import warnings

import pytest
import torch

from embodiedreamer_gym.policies.preferences import Guard, NoGradientWarning
from embodiedreamer_gym.policies.preferences.guard import warn_if_still


def shift(network, by: float) -> None:
    with torch.no_grad():
        network.layer.bias += by


def test_the_last_good_weights_come_back(network) -> None:
    guard = Guard(network, fall=2.0)
    shift(network, 1.0)
    assert guard.passes(-2.0)
    good = network.layer.bias.clone()
    shift(network, 1.0)
    assert not guard.passes(-2.1)
    assert torch.equal(network.layer.bias, good)


@pytest.mark.parametrize("winners", [float("nan"), float("-inf"), -100.0])
def test_before_the_first_epoch_the_given_weights_are_good(network, winners: float) -> None:
    given, guard = network.layer.bias.clone(), Guard(network)
    shift(network, 5.0)
    assert not guard.passes(winners)
    assert torch.equal(network.layer.bias, given)


def test_without_a_guard_everything_passes(network) -> None:
    guard = Guard(network, fall=None)
    shift(network, 1.0)
    moved = network.layer.bias.clone()
    assert guard.passes(-1e9) and torch.equal(network.layer.bias, moved)


def test_it_warns_of_a_missing_gradient_only() -> None:
    with pytest.warns(NoGradientWarning, match=r"no gradient at the start \(8.0e-07; .* without exploration noise"):
        warn_if_still(8e-7, 1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_if_still(0.65, 0.3)
