"""What can be built, and what is said where it cannot."""

from __future__ import annotations

import json

import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act import ActConfig
from embodiedreamer_gym.policies.act.network import Act
from tests.policies.act.tiny import CONFIG


def test_it_comes_back_from_json() -> None:
    assert ActConfig.of(json.loads(json.dumps(CONFIG.as_dict()))) == CONFIG


def test_the_defaults_are_the_papers_chunk_and_a_small_network() -> None:
    config = ActConfig(14, 14, ("head",), (128, 96))
    assert config.chunk == 100
    assert sum(p.numel() for p in Act(config).parameters()) < 1e6


def test_the_papers_sizes() -> None:
    """About 80 million weights, as the paper says (section V-C)."""
    paper = ActConfig(14, 14, ("head",), (128, 96), chunk=20).paper()
    assert (paper.chunk, paper.width, paper.feedforward, paper.encoders, paper.decoders) == (100, 512, 3200, 4, 1)
    shapes = {name: value.shape for name, value in Act(paper.with_(width=64, feedforward=64)).state_dict().items()}
    assert shapes["backbone.layer4.1.conv2.weight"] == (512, 512, 3, 3)
    assert (
        sum(name.startswith("backbone") and "conv" in name for name in shapes) == 17
    )  # ResNet18 without its last layer


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"chunk": 0}, "chunk is 0"),
        ({"width": 18}, "multiple of 4"),
        ({"cameras": ()}, "one to 3 cameras"),
        ({"cameras": ("a", "b", "c", "d")}, "one to 3 cameras"),
        ({"cameras": ("a", "a")}, "different names"),
        ({"norm": "batch"}, "group, frozen"),
        ({"widths": (12,)}, "multiples of 8"),
        ({"widths": ()}, "at least one stage"),
        ({"dropout": 1.0}, "dropout"),
        ({"image_size": (32,)}, "width and a height"),
        ({"latent": -1}, "latent is -1"),
        ({"action_size": 2.0}, "action_size is 2.0"),
    ],
)
def test_what_cannot_be_built(change: dict, said: str) -> None:
    with pytest.raises(PolicyError, match=said):
        CONFIG.with_(**change)


def test_other_keys_and_missing_ones() -> None:
    with pytest.raises(PolicyError, match="no 'n_obs_steps'"):
        ActConfig.of({**CONFIG.as_dict(), "n_obs_steps": 1})
    with pytest.raises(PolicyError, match="incomplete"):
        ActConfig.of({"chunk": 3})


@pytest.mark.parametrize(
    "change",
    [
        {"width": 8_000_000}, {"encoders": 10**9}, {"chunk": 10**9}, {"image_size": (10**6, 10**6)}, {"dropout": "some"},
        {"cameras": (1,)}, {"widths": 8}, {"objects": ("cup", 3)},
    ],
)  # fmt: skip
def test_rubbish_and_giants_are_refused(change: dict) -> None:
    with pytest.raises(PolicyError):
        ActConfig.of({**ActConfig(3, 2, ("head",), (32, 24)).as_dict(), **change})
