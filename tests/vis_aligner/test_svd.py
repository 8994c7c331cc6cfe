"""Stable Video Diffusion's classes behind the same interface, at a tiny size."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import load_aligner
from embodiedreamer_gym.vis_aligner.clip import Condition
from embodiedreamer_gym.vis_aligner.svd import load_svd, painted, save_svd, tiny_svd
from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train
from tests.vis_aligner.scenes import episode

pytest.importorskip("diffusers", reason="the extra [svd] is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")


def test_the_condition_is_the_papers() -> None:
    """The simulated picture, the masks added pixel-wise; objects show as their masks alone."""
    one = episode().condition
    picture = painted(one)
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
