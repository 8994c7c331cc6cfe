"""Stable Video Diffusion's classes behind the same interface, at a tiny size."""

from __future__ import annotations

import json
import os
import shutil

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import load_aligner
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.svd import load_svd, save_svd
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdSettings, with_mask_colours
from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train
from tests.vis_aligner.scenes import episode
from tests.vis_aligner.tiny_svd import tiny_networks, tiny_svd

pytest.importorskip("diffusers", reason="the extra [svd] is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")


def test_the_condition_is_the_papers() -> None:
    """The simulated picture, the masks added pixel-wise; objects show as their masks alone."""
    one = episode().condition
    picture = with_mask_colours(one)
    assert np.array_equal(picture[one.classes < 3], one.rgb[one.classes < 3])
    assert {tuple(c) for c in picture[one.classes == 3]} == {(255, 60, 60)}
    assert {tuple(c) for c in picture[one.classes == 4]} == {(60, 60, 255)}


def test_it_trains_and_its_folder_gives_the_same_frames(tmp_path) -> None:
    one, model = episode(), tiny_svd(chunk=3)
    before = [p.detach().clone() for p in model.network.parameters()]
    losses: list[float] = []
    config = TrainingConfig(steps=4, batch=1, own=1.0, rate=1e-4)
    train(model, [one], config, tmp_path / "run", lambda stage, step, loss: losses.append(loss))
    assert np.isfinite(losses).all() and len(losses) == 4
    assert any(not torch.equal(a, b) for a, b in zip(before, model.network.parameters(), strict=True))
    save_svd(model, tmp_path / "svd")
    again = load_aligner(tmp_path / "svd", steps=1)
    made, other = (m.render([one.references(0)], [one.condition.part(1, 4)])[0] for m in (model, again))
    assert made.shape == (3, 48, 64, 3) and again.chunk == 3
    assert np.abs(made.astype(int) - other).max() <= 1


def test_a_folder_of_stable_video_diffusion_is_taken_as_it_is(tmp_path) -> None:
    """Its U-Net takes the noise and one picture; the frames put together from other pictures change nothing before training."""
    unet, vae = tiny_networks(chunk=3)
    for network, name in ((unet, "unet"), (vae, "vae")):
        network.save_pretrained(tmp_path / name)
    model = load_svd(tmp_path, steps=2)
    assert model.chunk == 24 and model.steps == 2 and model.network.config.in_channels == 25
    noisy, given = torch.randn(2, 3, 4, 6, 8), torch.randn(2, 3, 21, 6, 8)
    sigma = torch.tensor([2.0, 700.0])
    with torch.no_grad():
        wide = model._velocity(noisy, sigma, given)
        told = {"encoder_hidden_states": torch.zeros(2, 1, 32), "added_time_ids": torch.tensor([[6.0, 127.0, 0.0]] * 2)}
        plain = unet(torch.cat([noisy, given[:, :, :4]], 2), 0.25 * torch.log(sigma), **told).sample
    assert torch.allclose(wide, plain, atol=1e-5)


def test_gradient_checkpointing_and_bfloat16_compute_the_same() -> None:
    one, losses, gradients = episode(), [], []
    for settings in (SvdSettings(), SvdSettings(gradient_checkpointing=True), SvdSettings(bf16=True)):
        model = tiny_svd(chunk=2, settings=settings)
        model.network.train()
        batch = [one.references(0)], [one.condition.part(1, 3)], [one.frames[1:3]]
        loss, _ = model.attempt(*batch, torch.Generator().manual_seed(0))
        loss.backward()
        assert model.network.is_gradient_checkpointing == settings.gradient_checkpointing
        losses.append(float(loss.detach()))
        gradients.append(model.network.conv_in.weight.grad)
        assert gradients[-1].dtype == torch.float32
    assert losses[1] == pytest.approx(losses[0], rel=1e-5) and torch.allclose(gradients[1], gradients[0], atol=1e-5)
    assert losses[2] == pytest.approx(losses[0], rel=0.02) and losses[2] != losses[0]


def test_models_of_former_releases_are_refused_with_the_way_out(tmp_path, saved_svd) -> None:
    shutil.copytree(saved_svd, tmp_path / "svd")
    (tmp_path / "svd" / "embodiedreamer.json").write_text('{"chunk": 3}')
    with pytest.raises(
        VisionError, match=r"predict the clean latents.*train it again.*vis train EPISODES --model svd --from"
    ):
        load_svd(tmp_path / "svd")


def test_bad_folders_and_sizes_are_refused(tmp_path) -> None:
    with pytest.raises(VisionError, match="holds no svd aligner"):
        load_svd(tmp_path)
    one, model = episode(), tiny_svd(chunk=3)
    odd = Condition(*(x[:, :47] for x in (one.condition.rgb, one.condition.classes, one.condition.depth)))
    references = one.references(0)
    from dataclasses import replace

    references = replace(references, last=references.last[:47])
    with pytest.raises(VisionError, match="multiples of 8"):
        model.render([references], [odd.part(1, 4)])


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("embodiedreamer.json", {"chunk": "seven"}, "chunk is a whole number from 1 to 1000"),
        ("embodiedreamer.json", {"chunk": 10**400}, "chunk is a whole number from 1 to 1000"),
        ("embodiedreamer.json", [3], "must be a JSON object"),
        (
            "unet/config.json",
            {"block_out_channels": [10**9, 64]},
            "block_out_channels in unet/config.json is too large",
        ),
        ("unet/config.json", {"layers_per_block": [[100]]}, "layers_per_block in unet/config.json is too large"),
        (
            "unet/config.json",
            {"block_out_channels": [8192, 8192]},
            "asks for [0-9]+ weights, but its files are smaller",
        ),
        ("unet/config.json", {"block_out_channels": "wide"}, "holds no svd aligner"),
        ("unet/config.json", {"num_attention_heads": [0, 0]}, "holds no svd aligner"),
        ("vae/config.json", [], "holds no svd aligner"),
        ("vae/config.json", {"down_block_types": ["DownEncoderBlock2D"]}, "latents are 8 pixels wide"),
    ],
)
def test_settings_of_other_types_or_huge_sizes_are_refused(tmp_path, saved_svd, file, change, said) -> None:
    shutil.copytree(saved_svd, tmp_path / "svd")
    path = tmp_path / "svd" / file
    path.write_text(json.dumps({**json.loads(path.read_text()), **change} if isinstance(change, dict) else change))
    with pytest.raises(VisionError, match=said):
        load_svd(tmp_path / "svd")


def test_a_pipe_in_place_of_a_config_is_refused(tmp_path, saved_svd) -> None:
    shutil.copytree(saved_svd, tmp_path / "svd")
    (tmp_path / "svd/vae/config.json").unlink()
    os.mkfifo(tmp_path / "svd/vae/config.json")
    with pytest.raises(VisionError, match="is not a regular file"):
        load_svd(tmp_path / "svd")


@pytest.fixture(scope="module")
def saved_svd(tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved") / "svd"
    save_svd(tiny_svd(chunk=3), folder)
    return folder
