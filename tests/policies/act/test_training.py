"""Training learns, repeats itself bit for bit, and goes on as if it had not been interrupted."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.learning import training as learning
from embodiedreamer_gym.policies.act import Act, ActPolicy, ActTraining, Samples, TrainingConfig, train
from embodiedreamer_gym.policies.act import training as module
from tests.policies.act.tiny import CONFIG, SIZE, Tiny

SHORT = TrainingConfig(steps=8, batch=4)
DROPS = CONFIG.with_(dropout=0.2, latent=4)  # everything that draws


def weights(policy: ActPolicy) -> dict[str, torch.Tensor]:
    return policy.network.state_dict()


def same(one: ActPolicy, two: ActPolicy) -> bool:
    return all(torch.equal(value, weights(two)[name]) for name, value in weights(one).items())


def test_it_learns_where_the_square_is() -> None:
    episodes = Tiny(lengths=(6,) * 16)
    training = ActTraining(Samples(episodes, CONFIG), TrainingConfig(steps=80, batch=16, learning_rate=3e-3))
    before = training.run(until=1)["l1"]
    after = training.run()["l1"]
    assert after < 0.6 * before  # half of it is the time, which cannot be seen
    told = training.policy()(training.samples.at(np.arange(0, 96, 6)).batch)
    assert np.abs(told[:, 0, 0] - episodes.columns).mean() < 0.06  # 0.24 where it does not look


def test_the_latent_is_learnt_and_dropped() -> None:
    training = ActTraining(Samples(Tiny(), DROPS), TrainingConfig(steps=40, batch=8, learning_rate=3e-3))
    first = training.run(until=1)
    assert first["loss"] == pytest.approx(first["l1"] + 10.0 * first["kl"], rel=1e-5)
    assert training.run()["kl"] < 0.6 * first["kl"]
    batch = training.samples.at(np.array([0])).batch
    np.testing.assert_array_equal(training.policy()(batch), training.policy()(batch))  # z = 0, no dropout


def test_padding_does_not_count() -> None:
    episodes = Tiny(lengths=(3,))  # shorter than a chunk
    training = ActTraining(Samples(episodes, CONFIG), replace(SHORT, rest=False))
    step = training.loss(0)["l1"]
    with torch.no_grad():  # what is said about the fourth step never matters
        training.network.queries.weight[3] += 100.0
        training.network.decoder.layers[0].self_attn.out_proj.weight.zero_()
        training.network.decoder.layers[0].self_attn.out_proj.bias.zero_()
    other = training.loss(0)["l1"]
    with torch.no_grad():
        training.network.queries.weight[3] -= 100.0
    torch.testing.assert_close(training.loss(0)["l1"], other)
    assert step > 0


def test_the_same_seed_gives_the_same_policy(tmp_path: Path) -> None:
    one, two = (train(Tiny(), DROPS, SHORT, tmp_path / name) for name in "ab")
    other = train(Tiny(), DROPS, TrainingConfig(steps=8, batch=4, seed=1), tmp_path / "c")
    assert same(one, two) and not same(one, other)
    assert (tmp_path / "a" / "curves.csv").read_text() == (tmp_path / "b" / "curves.csv").read_text()


def test_interrupted_and_gone_on_is_bit_for_bit_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "SAVED_EVERY", 3)
    monkeypatch.setattr(module, "SHOWN_EVERY", 2)
    whole = train(Tiny(), DROPS, SHORT, tmp_path / "whole")

    def stop(stage: str, count: int, of: int, **said: str) -> None:
        torch.rand(3)  # somebody else draws too
        if count == 5:  # two steps after the last checkpoint
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(Tiny(), DROPS, SHORT, tmp_path / "cut", stop)
    assert torch.load(tmp_path / "cut" / "checkpoint.pt", weights_only=True)["step"] == 3
    assert same(train(Tiny(), DROPS, SHORT, tmp_path / "cut"), whole)
    assert same(ActPolicy.load(tmp_path / "cut"), whole)
    assert (tmp_path / "cut" / "curves.csv").read_text() == (tmp_path / "whole" / "curves.csv").read_text()
    assert not list((tmp_path / "cut").glob(".*"))  # nothing half-written


def test_training_leaves_the_worlds_chance_alone(tmp_path: Path) -> None:
    torch.manual_seed(7)
    expected = torch.rand(2)
    torch.manual_seed(7)
    train(Tiny(), DROPS, SHORT, tmp_path)
    assert torch.equal(torch.rand(2), expected)


def test_what_is_finished_is_not_trained_again(tmp_path: Path) -> None:
    policy, counted = train(Tiny(), CONFIG, SHORT, tmp_path), []
    again = train(Tiny(), CONFIG, SHORT, tmp_path, lambda *said, **more: counted.append(said))
    assert not counted and same(policy, again)
    for name in ("weights.pt", "config.json"):  # killed between the checkpoint and the policy
        (tmp_path / name).unlink()
    train(Tiny(), CONFIG, SHORT, tmp_path)
    assert same(policy, ActPolicy.load(tmp_path))


def test_curves_and_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SHOWN_EVERY", 4)
    said, told = [], []
    train(
        Tiny(), CONFIG, TrainingConfig(steps=9, batch=2), tmp_path, lambda *row, **more: said.append(row), told.append
    )
    assert said == [("training", step, 9) for step in range(1, 10)]
    rows = list(csv.DictReader((tmp_path / "curves.csv").read_text().splitlines()))
    assert [row["step"] for row in rows] == ["4", "8", "9"]
    assert float(rows[-1]["rate"]) < float(rows[0]["rate"]) * 100 and float(rows[-1]["loss"]) > 0
    try:
        import torch.utils.tensorboard  # noqa: F401
    except ImportError:
        assert len(told) == 1 and "embodiedreamer-gym[tensorboard]" in told[0]
    else:
        assert not told and list((tmp_path / "tensorboard").glob("events*"))


@pytest.mark.parametrize("what", ["settings", "sizes", "episodes", "states"])
def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path, what: str) -> None:
    train(Tiny(), CONFIG, SHORT, tmp_path)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    episodes = Tiny(seed=1) if what == "episodes" else Tiny()
    if what == "states":
        states, what = episodes.states, "episodes"
        episodes.states = lambda i: states(i) + 0.1  # type: ignore[method-assign]
    config = CONFIG.with_(chunk=3) if what == "sizes" else CONFIG
    settings = TrainingConfig(steps=9, batch=4) if what == "settings" else SHORT
    with pytest.raises(PolicyError, match=f"other {what}"):
        train(episodes, config, settings, tmp_path)
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    (tmp_path / "checkpoint.pt").write_bytes(b"no checkpoint")
    with pytest.raises(PolicyError, match="damaged or another kind of file"):
        train(Tiny(), CONFIG, SHORT, tmp_path)


def test_a_loss_that_explodes_is_said() -> None:
    training = ActTraining(Samples(Tiny(), CONFIG), SHORT)
    with torch.no_grad():
        training.network.head.weight.fill_(torch.inf)
    with pytest.raises(PolicyError, match="not finite at step 0; lower the learning rate"):
        training.run()


def test_counts_are_checked() -> None:
    with pytest.raises(PolicyError, match="batch is 0"):
        TrainingConfig(batch=0)
    with pytest.raises(PolicyError, match="chunk_start_share is 1"):
        TrainingConfig(chunk_start_share=1.5)
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(PolicyError, match="the learning rate is"):
            TrainingConfig(learning_rate=rate)
    with pytest.raises(PolicyError, match="seed is -1"):
        TrainingConfig(seed=-1)


def test_half_of_the_starts_are_mirrored(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The action's first number changes its sign just where the picture is flipped, in about half of a batch."""
    episodes = Tiny(lengths=(6,) * 16)
    episodes._states, episodes.state_size = [states[:, :2] for states in episodes._states], 2
    drawn = []
    forward = Act.forward

    def watched(network, batch, actions, *others):
        drawn.append((batch["pixels"]["head"], network.denormalise(actions)))
        return forward(network, batch, actions, *others)

    monkeypatch.setattr(Act, "forward", watched)
    train(episodes, CONFIG.with_(state_size=2), replace(SHORT, steps=1, batch=64, mirror=(-1, 2)), tmp_path / "a")
    pictures, actions = drawn[0]
    bright = (pictures[:, SIZE[1] // 2, :, 1] > 200).argmax(1)  # the square's first column
    mirrored = actions[:, 0, 0].numpy() < 0
    column = np.where(mirrored, SIZE[0] - 4 - bright, bright)
    assert np.abs(column - np.floor(np.abs(actions[:, 0, 0].numpy()) * (SIZE[0] - 4))).max() <= 1
    assert 16 < mirrored.sum() < 48
    with pytest.raises(PolicyError, match="the mirror has 2 joints, but the episodes have states of 3 numbers"):
        train(Tiny(), CONFIG, replace(SHORT, mirror=(-1, 2)), tmp_path / "b")
