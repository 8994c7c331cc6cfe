"""Fine-tuning on pairs: what rises and falls, the collapse of the paper's form, and the guard."""

from __future__ import annotations

import copy
import warnings

import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import (
    LossConfig,
    NoGradientWarning,
    PreferenceSet,
    TuningConfig,
    fine_tune,
)
from embodiedreamer_gym.policies.preferences.training import Pairs
from tests.policies.preferences.conftest import Linear


def weights(network) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in network.parameters()])


def test_winners_rise_over_losers(network, pairs) -> None:
    tuned = fine_tune(network, pairs, TuningConfig(epochs=30, learning_rate=1e-3))
    assert len(tuned.loss) == 31 and tuned.winner[0] == tuned.loser[0] == 0.0
    assert tuned.winner[-1] > 0 > tuned.loser[-1] and tuned.loss[-1] < tuned.loss[0]
    assert tuned.stopped is None and tuned.gradient > 1e-3 and tuned.error > 0.1


def test_the_seed_decides(network, pairs) -> None:
    found = []
    for seed in (0, 0, 1):
        one = copy.deepcopy(network)
        fine_tune(one, pairs, TuningConfig(epochs=2, batch=3, learning_rate=1e-2, seed=seed))
        found.append(weights(one))
    assert torch.equal(found[0], found[1]) and not torch.equal(found[0], found[2])


def test_noiseless_rollouts_have_no_gradient(network, roll) -> None:
    """The paper's form taken literally: a^ = a for winner and loser, so nothing says where to go."""
    own = [roll(seed, attempt, 0.02 + 0.1 * attempt, noise=0.0) for seed in range(4) for attempt in range(2)]
    with pytest.warns(NoGradientWarning, match="roll out with noise"):
        tuned = fine_tune(network, PreferenceSet.choose(own), TuningConfig(LossConfig("paper"), epochs=1))
    assert tuned.gradient < 1e-5 and tuned.error < 1e-3
    noisy = [roll(seed, attempt, 0.02 + 0.1 * attempt) for seed in range(4) for attempt in range(2)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fine_tune(network, PreferenceSet.choose(noisy), TuningConfig(LossConfig("paper"), epochs=1))


def test_the_papers_form_falls_and_the_guard_stops_it(network, pairs) -> None:
    """Without bound: winners fall with the losers while the loss gets ever smaller."""
    given, free = copy.deepcopy(network), copy.deepcopy(network)
    settings = {"epochs": 60, "learning_rate": 0.05}
    fallen = fine_tune(free, pairs, TuningConfig(LossConfig("paper"), fall=None, **settings))
    assert fallen.winner[-1] < -50 and fallen.loser[-1] < fallen.winner[-1] and fallen.loss[-1] < 0.5 < fallen.loss[0]
    assert fallen.stopped is None

    guarded = fine_tune(network, pairs, TuningConfig(LossConfig("paper"), fall=1.0, **settings))
    assert guarded.stopped is not None and guarded.stopped < 60 and len(guarded.loss) == guarded.stopped + 1
    assert guarded.winner[-1] < -1.0 <= min(guarded.winner[:-1])
    before = Pairs(given, pairs, TuningConfig()).likelihood()[: len(pairs)].mean()
    after = Pairs(network, pairs, TuningConfig()).likelihood()[: len(pairs)].mean()
    assert float(after - before) == pytest.approx(guarded.winner[-2], abs=1e-4), "the weights of the epoch before"

    held = fine_tune(given, pairs, TuningConfig(fall=None, **settings))
    assert held.winner[-1] > -0.5, "the default keeps the winners by itself"


def test_a_few_chunks_at_a_time_give_the_same_gradient(network, pairs) -> None:
    chosen, found = torch.tensor([5, 0, 3]), []
    for rows in (512, 7):
        network.zero_grad()
        data = Pairs(network, pairs, TuningConfig(rows=rows))
        with torch.no_grad():
            network.layer.bias += 0.1
        data.backward(chosen)
        found.append(network.layer.weight.grad.clone())
        with torch.no_grad():
            network.layer.bias -= 0.1
    assert torch.allclose(found[0], found[1], rtol=1e-4, atol=1e-6) and found[0].abs().max() > 0


def test_dropout_stays_off(pairs) -> None:
    torch.manual_seed(0)
    network, found = Linear(dropout=0.9), []
    for _ in range(2):
        one = copy.deepcopy(network).train()
        tuned = fine_tune(one, pairs, TuningConfig(epochs=2))
        found.append((tuned, weights(one)))
        assert tuned.winner[0] == tuned.loser[0] == 0.0 and not one.training
    assert found[0][0] == found[1][0] and torch.equal(found[0][1], found[1][1])


def test_progress_is_told(network, pairs) -> None:
    told = []
    fine_tune(network, pairs, TuningConfig(epochs=3), lambda *said, **more: told.append((*said, more["winners"])))
    assert [said[:3] for said in told] == [("fine-tuning", n, 3) for n in (1, 2, 3)] and "nats" in told[0][3]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"epochs": 0}, "epochs is 0"),
        ({"batch": 0}, "batch is 0"),
        ({"sigma": 0.0}, "sigma is 0.0"),
        ({"learning_rate": float("nan")}, "learning_rate is nan"),
        ({"fall": -1.0}, "fall is -1.0"),
    ],
)
def test_settings_are_checked(change, message: str) -> None:
    with pytest.raises(PolicyError, match=message):
        TuningConfig(**change)
