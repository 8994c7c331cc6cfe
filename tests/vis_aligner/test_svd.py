"""Stable Video Diffusion's classes behind the same interface, at a tiny size."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import load_aligner
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.svd import load_svd, save_svd, with_mask_colours
from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train
from tests.vis_aligner.scenes import episode
from tests.vis_aligner.tiny_svd import tiny_svd

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
    again = load_aligner(tmp_path / "svd")
    made, other = (m.render([one.references(0)], [one.condition.part(1, 4)])[0] for m in (model, again))
    assert made.shape == (3, 48, 64, 3) and again.chunk == 3
    assert np.abs(made.astype(int) - other).max() <= 1


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
        ("embodiedreamer.json", {"chunk": "seven"}, "chunk is a whole number of 1 to 1000"),
        ("embodiedreamer.json", {"chunk": 10**400}, "chunk is a whole number of 1 to 1000"),
        ("embodiedreamer.json", [3], "must be a JSON object"),
        (
            "unet/config.json",
            {"block_out_channels": [10**9, 64]},
            "block_out_channels in unet/config.json is too large",
        ),
        ("unet/config.json", {"layers_per_block": [[100]]}, "layers_per_block in unet/config.json is too large"),
        ("unet/config.json", {"block_out_channels": [8192, 8192]}, "asks for [0-9]+ weights, its files are smaller"),
        ("unet/config.json", {"block_out_channels": "wide"}, "holds no svd aligner"),
        ("unet/config.json", {"num_attention_heads": [0, 0]}, "holds no svd aligner"),
        ("vae/config.json", [], "holds no svd aligner"),
    ],
)
def test_settings_of_other_types_or_huge_sizes_are_refused(tmp_path, saved_svd, file, change, said) -> None:
    shutil.copytree(saved_svd, tmp_path / "svd")
    path = tmp_path / "svd" / file
    path.write_text(json.dumps({**json.loads(path.read_text()), **change} if isinstance(change, dict) else change))
    with pytest.raises(VisionError, match=said):
        load_svd(tmp_path / "svd")


@pytest.fixture(scope="module")
def saved_svd(tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved") / "svd"
    save_svd(tiny_svd(chunk=3), folder)
    return folder
