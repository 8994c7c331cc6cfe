"""Both models on another device than the CPU: "meta", which holds no numbers but refuses tensors of the CPU, as a GPU does."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import load_aligner
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.motion_window import windows
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdSettings
from embodiedreamer_gym.vis_aligner.velocity import sample_velocity, sigmas
from tests.vis_aligner.scenes import HEIGHT, WIDTH, episode
from tests.vis_aligner.toy_svd import CHANNELS, toy_svd


@pytest.fixture(scope="module")
def batch():
    one = episode()
    return [one.references(0)], [one.condition.part(1, 4)], [one.frames[1:4]]


def test_the_device_refuses_tensors_of_the_cpu() -> None:
    with pytest.raises(RuntimeError, match="device"):
        torch.ones(3, device="meta") + torch.ones(3)


def test_the_lean_network_computes_there(batch) -> None:
    aligner = LeanAligner(Lean(LeanConfig((8, 8, 8, 16))).to("meta"), steps=2)
    references, conditions, truth = batch
    places = windows(references, conditions)
    assert places is not None
    made = aligner._sampled(aligner._stack(references, conditions, places))
    assert made.device.type == "meta" and made.shape[:3] == (1, 3, 3)
    loss, _ = aligner.attempt(references, conditions, truth, torch.Generator().manual_seed(0))
    loss.backward()
    assert loss.device.type == "meta" and aligner.network.out.weight.grad is not None


def test_the_svd_networks_compute_there(batch) -> None:
    aligner = toy_svd()
    aligner.network.to("meta")
    aligner.latents = lambda pictures: torch.zeros(
        len(pictures), CHANNELS, HEIGHT // 8, WIDTH // 8
    )  # the toy's has no weights
    given = aligner._given(*batch[:2])
    noise = torch.randn(1, 4, CHANNELS, HEIGHT // 8, WIDTH // 8, device="meta")
    made = sample_velocity(lambda y, sigma: aligner._velocity(y, sigma, given), noise, sigmas(2))
    assert made.device.type == "meta" and made.shape == noise.shape
    loss, _ = aligner.attempt(*batch, torch.Generator().manual_seed(0))
    loss.backward()
    assert loss.device.type == "meta"


@pytest.mark.skipif(not torch.accelerator.is_available(), reason="no accelerator")
def test_the_shipped_model_makes_the_same_frames_there(batch) -> None:
    here, there = (load_aligner("lean", device=name).render(*batch[:2])[0] for name in ("cpu", "auto"))
    assert np.abs(here.astype(int) - there).max() <= 1


def test_a_device_that_is_not_there_and_settings_of_svd_are_refused() -> None:
    with pytest.raises(VisionError, match="device 'cuda:97' is not available here"):
        load_aligner("lean", device="cuda:97")
    with pytest.raises(VisionError, match="for svd aligners, but lean is lean"):
        load_aligner("lean", svd=SvdSettings(bf16=True))
