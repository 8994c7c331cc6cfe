"""The two kinds of network: `act`, with and without the objects' poses as a further input, and `object_pose`."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import pytest
import torch

from embodiedreamer_gym.cli import policy_train
from embodiedreamer_gym.cli.command import build_parser
from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act import Act, ActConfig, ActPolicy, ActTraining, Samples, TrainingConfig, train
from embodiedreamer_gym.policies.act import object_pose_head as module
from tests.policies.act.test_object_pose_head import Masked
from tests.policies.act.tiny import CONFIG, Tiny


def options(*words: str) -> argparse.Namespace:
    return build_parser().parse_args(["policy", "train", "--data", "d", "--out", "o", *words])


def test_the_default_is_object_pose_where_there_are_masks() -> None:
    assert policy_train.network_config(options(), Masked(), print).kind == "object_pose"
    assert policy_train.network_config(options("--no-masks"), Masked(), print).kind == "act"
    assert policy_train.network_config(options(), Tiny(), print).kind == "act"


@pytest.mark.parametrize("episodes", [Tiny(), Masked()])
def test_act_has_all_parts_of_the_papers_network(episodes: Tiny) -> None:
    config = policy_train.network_config(options("--kind", "act"), episodes, print)
    network = Act(config.with_(width=16, heads=2, feedforward=16, widths=(8, 8)))
    assert config.kind == "act" and config.chunk == 100 and config.latent == 32
    assert network.backbone and network.encoder and network.latent_encoder
    assert (network.poses is not None) == (network.object_pose_heads is not None) == isinstance(episodes, Masked)


def test_object_pose_needs_masks() -> None:
    for words, episodes in ((("--kind", "object_pose"), Tiny()), (("--kind", "object_pose", "--no-masks"), Masked())):
        with pytest.raises(PolicyError, match="learns from masks"):
            policy_train.network_config(options(*words), episodes, print)


def test_act_uses_both_pictures_and_poses(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LEAST_STEPS", 3)
    monkeypatch.setattr(module, "STEPS_PER_EPISODE", 1)
    config = CONFIG.small(("thing",)).with_(latent=4)
    episodes: Any = Masked()
    training = ActTraining(Samples(episodes, config), TrainingConfig(steps=4, batch=4))
    before = float(training.loss(1)["loss"].detach())
    training.keep_object_poses()
    batch = training.samples.draw(np.random.default_rng(0), 2).batch
    assert set(batch) == {"agent_pos", "object_poses", "pixels"}
    assert float(training.loss(1)["loss"].detach()) == pytest.approx(before, rel=1e-5)
    with torch.no_grad():
        plain = training.network.mean(batch)
        moved = training.network.mean({**batch, "object_poses": batch["object_poses"] + 1})
        dark = training.network.mean({**batch, "pixels": {"head": batch["pixels"]["head"] // 2}})
    assert not torch.allclose(plain, moved) and not torch.allclose(plain, dark)
    train(episodes, config, TrainingConfig(steps=2, batch=4), tmp_path / "a")
    assert ActPolicy.load(tmp_path / "a").network.config == config


def test_a_configuration_of_before_is_of_the_same_kind() -> None:
    data = {key: value for key, value in CONFIG.with_(objects=("cup",)).as_dict().items() if key != "transformer"}
    assert ActConfig.of(data).kind == "object_pose"
