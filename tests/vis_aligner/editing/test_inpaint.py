"""Repainting by a diffusion model: what it is asked, and what is taken of its answer."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.vis_aligner.editing import Inpaint, apply, draws_of
from embodiedreamer_gym.vis_aligner.editing import inpaint as module
from tests.vis_aligner.editing.room import classes, masks, picture

IMAGE = picture(classes())


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """A stand-in that paints everything in the noise's grey, and what it was asked."""
    calls: list[dict[str, Any]] = []

    def pipeline(**given: Any) -> SimpleNamespace:
        calls.append(given)
        grey = float(torch.rand(1, generator=given["generator"]))
        return SimpleNamespace(images=np.full((1, given["height"], given["width"], 3), grey, np.float32))

    monkeypatch.setattr(module, "load_pipeline", lambda path: pipeline)
    return calls


def test_it_is_asked_at_its_own_size_and_answers_in_the_mask(asked) -> None:
    editor = Inpaint("model", ("table",), edge=96)
    done = apply(editor, IMAGE, masks(), 0, "a marble table")
    given = asked[0]
    assert (given["width"], given["height"]) == (128, 96) and given["prompt"] == "a marble table"
    assert given["image"].shape == (1, 3, 96, 128) and 0.5 < float(given["image"].max()) <= 1.1
    assert given["mask_image"].unique().tolist() == [0.0, 1.0]
    changed = (done != IMAGE).any(axis=2)
    assert not changed[~masks()["table"]].any() and len(np.unique(done[masks()["table"]])) == 1
    again, other = (apply(editor, IMAGE, masks(), seed, "a marble table") for seed in (0, 1))
    assert np.array_equal(done, again) and not np.array_equal(done, other)
    assert asked[0]["generator"].initial_seed() == draws_of(editor, masks(), 0)["seed"]


def test_what_it_needs(asked) -> None:
    with pytest.raises(VisionError, match="needs a prompt"):
        apply(Inpaint("model"), IMAGE, masks(), 0)
    with pytest.raises(VisionError, match="no 'sofa' to inpaint"):
        apply(Inpaint("model", ("sofa",)), IMAGE, masks(), 0, "red")


def test_a_folder_that_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(VisionError, match="does not exist"):
        apply(Inpaint(tmp_path / "none"), IMAGE, masks(), 0, "red")
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(MissingExtraError, match="pip install"):
        apply(Inpaint(tmp_path), IMAGE, masks(), 0, "red")


def test_a_folder_without_a_model(tmp_path: Path) -> None:
    pytest.importorskip("transformers", reason="inpainting needs transformers")
    pytest.importorskip("diffusers", reason="inpainting needs diffusers")
    with pytest.raises(VisionError, match="holds no inpainting pipeline"):
        apply(Inpaint(tmp_path), IMAGE, masks(), 0, "red")


def test_the_real_classes_tiny_and_untrained(tmp_path: Path) -> None:
    t = pytest.importorskip("transformers", reason="inpainting needs transformers")
    d = pytest.importorskip("diffusers", reason="inpainting needs diffusers")
    torch.manual_seed(0)
    unet = d.UNet2DConditionModel(
        block_out_channels=(8, 16), layers_per_block=1, sample_size=8, in_channels=9, out_channels=4, norm_num_groups=4,
        down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"), up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
        cross_attention_dim=16, attention_head_dim=2,
    )  # fmt: skip
    vae = d.AutoencoderKL(
        block_out_channels=(8, 8, 8, 8), norm_num_groups=4, latent_channels=4,
        down_block_types=("DownEncoderBlock2D",) * 4, up_block_types=("UpDecoderBlock2D",) * 4,
    )  # fmt: skip
    words = tmp_path / "words"
    words.mkdir()
    (words / "vocab.json").write_text('{"<|startoftext|>": 0, "<|endoftext|>": 1, "r": 2, "e": 3, "d</w>": 4}')
    (words / "merges.txt").write_text("#version: 0.2\n")
    small = {"hidden_size": 16, "intermediate_size": 16, "num_attention_heads": 2, "num_hidden_layers": 1}
    text = t.CLIPTextModel(t.CLIPTextConfig(vocab_size=8, bos_token_id=0, eos_token_id=1, pad_token_id=1, **small))
    tokens = t.CLIPTokenizer(str(words / "vocab.json"), str(words / "merges.txt"), model_max_length=77)
    made = d.StableDiffusionInpaintPipeline(
        vae,
        text,
        tokens,
        unet,
        d.DDIMScheduler(steps_offset=1, clip_sample=False),
        None,
        None,
        requires_safety_checker=False,
    )
    made.save_pretrained(tmp_path / "model")
    editor = Inpaint(tmp_path / "model", ("table",), edge=48, steps=2)
    done = apply(editor, IMAGE, masks(), 0, "red")
    changed = (done != IMAGE).any(axis=2)
    assert changed[masks()["table"]].mean() > 0.9 and not changed[~masks()["table"]].any()
    assert np.array_equal(done, apply(editor, IMAGE, masks(), 0, "red"))
