"""The network: shapes, what it depends on, and the pieces against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act import Act
from embodiedreamer_gym.policies.act.resnet import FrozenNorm, ResNet
from embodiedreamer_gym.policies.act.statistics import Statistics
from embodiedreamer_gym.policies.act.transformer import sine_1d, sine_2d
from tests.policies.act.tiny import CONFIG, SIZE


def a_batch(count: int = 2, cameras: tuple[str, ...] = ("head",), size: tuple[int, int] = SIZE) -> dict:
    rng = np.random.default_rng(0)
    pixels = {c: rng.integers(0, 255, (count, *size[::-1], 3), dtype=np.uint8) for c in cameras}
    return {"agent_pos": rng.normal(size=(count, 3)).astype(np.float32), "pixels": pixels}


def a_network(**changes) -> Act:
    torch.manual_seed(0)
    return Act(CONFIG.with_(**changes)).eval()


@pytest.mark.parametrize("cameras", [("head",), ("head", "left", "right")])
@pytest.mark.parametrize("latent", [0, 4])
def test_actions_have_their_shape_and_each_input_counts(cameras: tuple[str, ...], latent: int) -> None:
    network, batch = a_network(cameras=cameras, latent=latent), a_batch(cameras=cameras)
    actions = network.mean(batch)
    assert actions.shape == (2, 4, 2)
    assert not torch.allclose(actions[:, 0], actions[:, 1])  # each step of the chunk has a query of its own
    for camera in cameras:
        other = {**batch, "pixels": {**batch["pixels"], camera: 255 - batch["pixels"][camera]}}
        assert not torch.allclose(network.mean(other), actions, atol=1e-5)
    assert not torch.allclose(network.mean({**batch, "agent_pos": batch["agent_pos"] + 1}), actions, atol=1e-5)


def test_a_batch_is_its_rows() -> None:
    network, batch = a_network(), a_batch(3)
    alone = {"agent_pos": batch["agent_pos"][1:2], "pixels": {"head": batch["pixels"]["head"][1:2]}}
    torch.testing.assert_close(network.mean(batch)[1:2], network.mean(alone), atol=1e-5, rtol=1e-4)


def test_tensors_and_arrays_are_alike() -> None:
    network, batch = a_network(), a_batch()
    tensors = {"agent_pos": torch.from_numpy(batch["agent_pos"]),
               "pixels": {"head": torch.from_numpy(batch["pixels"]["head"])}}  # fmt: skip
    assert torch.equal(network.mean(batch), network.mean(tensors))


def test_the_latent_sees_actions_but_not_padding() -> None:
    network, batch = a_network(latent=4), a_batch()
    actions, noise = torch.randn(2, 4, 2, generator=torch.Generator().manual_seed(0)), torch.zeros(2, 4)
    padding = torch.tensor([[False, False, True, True]] * 2)
    predicted, divergence = network(batch, actions, padding, noise)
    hidden, seen = actions.clone(), actions.clone()
    hidden[:, 2:] += 5.0
    seen[:, 1] += 5.0
    torch.testing.assert_close(network(batch, hidden, padding, noise)[0], predicted)
    assert not torch.allclose(network(batch, seen, padding, noise)[0], predicted, atol=1e-5)
    assert (divergence > 0).all()


def test_the_divergence_is_that_of_torch() -> None:
    network, batch = a_network(latent=4), a_batch()
    actions, padding = torch.ones(2, 4, 2), torch.zeros(2, 4, dtype=torch.bool)
    mu, log_variance = network._encode_latent(network._state(batch), actions, padding)
    normal = torch.distributions.Normal
    truth = torch.distributions.kl_divergence(normal(mu, (0.5 * log_variance).exp()), normal(0.0, 1.0)).sum(1)
    torch.testing.assert_close(network(batch, actions, padding, torch.zeros(2, 4))[1], truth)


def test_without_noise_or_latent_it_is_the_mean() -> None:
    actions, padding = torch.ones(2, 4, 2), torch.zeros(2, 4, dtype=torch.bool)
    for latent in (0, 4):
        network = a_network(latent=latent)
        predicted, divergence = network(a_batch(), actions, padding)
        assert torch.equal(predicted, network.mean(a_batch()))
        assert divergence.tolist() == [0, 0]


def test_normalisation_there_and_back() -> None:
    states, actions = np.random.default_rng(0).normal(3, 2, (50, 3)), np.zeros((50, 2))
    actions[:, 0] = np.linspace(-1, 5, 50)
    network = Act(CONFIG, Statistics.measure([states], [actions], 1))
    scaled = network.normalise(torch.from_numpy(actions).float())
    assert abs(float(scaled[:, 0].mean())) < 1e-5 and abs(float(scaled[:, 0].std(correction=0)) - 1) < 1e-5
    assert scaled[:, 1].abs().max() == 0  # an action that never moves stays finite
    torch.testing.assert_close(network.denormalise(scaled), torch.from_numpy(actions).float())
    batch = {**a_batch(50), "agent_pos": states}
    assert abs(float(network._state(batch).mean())) < 1e-5


def test_pictures_of_another_size_are_scaled() -> None:
    network = a_network()
    small, large = a_batch(), a_batch()
    large["pixels"] = {"head": small["pixels"]["head"].repeat(2, 1).repeat(2, 2)}
    torch.testing.assert_close(network.mean(small), network.mean(large), atol=0.2, rtol=0.2)


def test_what_does_not_fit_is_said() -> None:
    with pytest.raises(PolicyError, match="camera 'head', but was given only pictures of: wrist"):
        a_network().mean(a_batch(cameras=("wrist",)))
    with pytest.raises(PolicyError, match="states of 3 numbers"):
        a_network().mean({**a_batch(), "agent_pos": np.zeros((2, 14), np.float32)})
    for batch, said in (
        ({"pixels": {}}, r"needs the state \(agent_pos\), but the batch contains only: pixels"),
        ({"agent_pos": a_batch()["agent_pos"]}, "only pictures of: none"),
        ({**a_batch(), "agent_pos": np.full((2, 3), np.nan, np.float32)}, "not finite"),
        (
            {**a_batch(), "pixels": {"head": np.zeros((24, 32, 3), np.uint8)}},
            r"\(B, H, W, 3\) uint8, not \(24, 32, 3\)",
        ),
        ({**a_batch(), "pixels": {"head": np.zeros((2, 3, 24, 32), np.uint8)}}, r"not \(2, 3, 24, 32\)"),
        ({**a_batch(), "pixels": {"head": np.zeros((2, 24, 32, 3), np.float32)}}, "float32 of 'head'"),
    ):
        with pytest.raises(PolicyError, match=said):
            a_network().mean(batch)
    bad = Statistics(*(torch.full_like(v, torch.nan) for v in vars(Statistics.neutral(CONFIG)).values()))
    with pytest.raises(PolicyError, match="state_mean"):
        Act(CONFIG, bad)


def test_frozen_norm_is_batch_norm_at_rest() -> None:
    frozen, batch_norm = FrozenNorm(4), torch.nn.BatchNorm2d(4).eval()
    generator = torch.Generator().manual_seed(0)
    state = {name: torch.rand(4, generator=generator) + 0.5 for name in frozen.state_dict()}
    frozen.load_state_dict(state)
    batch_norm.load_state_dict({**state, "num_batches_tracked": torch.tensor(0)})
    x = torch.randn(2, 4, 3, 3, generator=generator)
    torch.testing.assert_close(frozen(x), batch_norm(x))
    assert not list(frozen.parameters())


def test_the_resnets_features_are_as_large_as_positions_say() -> None:
    for width, height in ((128, 96), (33, 25), (640, 480)):
        features = ResNet((8, 8, 8), "group")(torch.zeros(1, 3, height, width))
        assert features.shape == (1, 8, -(-height // 16), -(-width // 16))


def test_placed_tokens_know_where_they_are() -> None:
    placed, plain = a_network(placed=True), a_network(placed=False)
    plain.load_state_dict(placed.state_dict())  # no weights of its own
    assert not torch.allclose(placed.mean(a_batch()), plain.mean(a_batch()), atol=1e-4)
    placed.positions.zero_()
    plain.positions.zero_()
    torch.testing.assert_close(placed.mean(a_batch()), plain.mean(a_batch()))


def test_positions_are_sines() -> None:
    one = sine_1d(5, 8)
    assert one.shape == (5, 8) and one[0].tolist() == [0, 1] * 4
    assert float(one[3, 2]) == pytest.approx(np.sin(3 / 10_000**0.25), abs=1e-6)
    two = sine_2d(3, 4, 8)
    assert two.shape == (12, 8)
    assert torch.equal(two[0, :4], two[3, :4])  # the same row
    assert torch.equal(two[1, 4:], two[9, 4:])  # the same column
    assert float(two[0, 0]) == pytest.approx(np.sin(2 * np.pi / 3), abs=1e-5)  # rows count from 1, the last at 2 pi
