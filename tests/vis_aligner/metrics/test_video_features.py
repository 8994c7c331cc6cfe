"""rfvd grows with every kind of damage; FVD takes the user's network as i3d_torchscript.pt is called."""

from __future__ import annotations

import itertools
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import I3d, frechet_distance, random_features
from embodiedreamer_gym.vis_aligner.metrics.video_features import DIMENSIONS, _filters, clips_of


@pytest.fixture(scope="module")
def clips(bench) -> np.ndarray:
    """Six clips (48, H, W, 3): the bench forth, back and mirrored."""
    one = bench.frames[:16]
    return np.concatenate([one, one[::-1], one[:, :, ::-1]])


def blurred(frames: np.ndarray, sd: float) -> np.ndarray:
    return np.stack([cv2.GaussianBlur(frame, (0, 0), sd) for frame in frames])


def noisy(frames: np.ndarray, sd: float) -> np.ndarray:
    added = np.random.default_rng(3).normal(0, sd, frames.shape)
    return np.clip(np.round(frames + added), 0, 255).astype(np.uint8)


def shifted(frames: np.ndarray, by: float) -> np.ndarray:
    return np.clip(np.round(frames + np.array([by, -by / 2, by / 2])), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("damage", "amounts"), [(noisy, (2, 4, 8, 16, 32)), (blurred, (0.5, 1, 2, 4)), (shifted, (2, 4, 8, 16))]
)
def test_rfvd_grows_with_damage(clips: np.ndarray, damage, amounts: tuple[float, ...]) -> None:
    truth = random_features(clips)
    values = [0.0, *(frechet_distance(truth, random_features(damage(clips, a))) for a in amounts)]
    assert frechet_distance(truth, truth) < 1e-6
    assert all(after > 1.5 * before + 1e-3 for before, after in itertools.pairwise(values)), values


def test_rfvd_sees_that_a_video_stands_still(clips: np.ndarray) -> None:
    truth, frozen = random_features(clips), random_features(clips[::8].repeat(8, axis=0))
    assert frechet_distance(truth, frozen) > 5 * frechet_distance(truth, random_features(noisy(clips, 2)))


def test_features_are_the_same_each_time_and_one_row_a_clip(clips: np.ndarray) -> None:
    assert random_features(clips).shape == (6, DIMENSIONS)
    assert np.array_equal(random_features(clips), random_features(clips))
    assert random_features(clips[:7]).shape == (0, DIMENSIONS)
    assert [len(c) for c in clips_of(clips[:17], 8)] == [8, 8]


def test_some_filters_see_no_even_colour_and_some_only_change() -> None:
    for filters in _filters():
        spatial, temporal = filters[::4].sum(dim=(3, 4)), filters[2::4].sum(dim=2)
        assert spatial.abs().max() < 1e-5 and temporal.abs().max() < 1e-5
        assert filters.square().sum(dim=(1, 2, 3, 4)).numpy() == pytest.approx(1.0, abs=1e-5)
        assert filters[1::2].sum(dim=(3, 4)).abs().max() > 0.1


class Stub(torch.nn.Module):
    """Takes what I3D takes; its features are means over the parts of the video it was given."""

    def forward(self, x: torch.Tensor, rescale: bool = False, resize: bool = False, return_features: bool = False):
        if not return_features:
            return x.sum()
        y = x / 127.5 - 1.0 if rescale else x
        if resize:
            y = torch.nn.functional.interpolate(y, size=[x.size(2), 224, 224], mode="trilinear")
        return y.mean(dim=[3, 4]).flatten(1)


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("i3d") / "stub.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torch.jit.script, which newer releases call old
        torch.jit.script(Stub()).save(str(path))
    return path


def test_the_network_is_asked_as_i3d_is(network: Path, clips: np.ndarray) -> None:
    features = I3d.load(network).features(clips)
    assert features.shape == (3, 48)  # clips of 16
    expected = clips[:16].mean(axis=(1, 2)).T.ravel() / 127.5 - 1.0
    assert features[0] == pytest.approx(expected, abs=0.02)
    assert I3d.load(network).features(clips[:15]).size == 0


def test_another_network_is_refused(tmp_path: Path, network: Path, clips: np.ndarray) -> None:
    with pytest.raises(VisionError, match="no such file"):
        I3d.load(tmp_path / "absent.pt")
    text = tmp_path / "text.pt"
    text.write_text("no network")
    with pytest.raises(VisionError, match="not a TorchScript file"):
        I3d.load(text)
    other = tmp_path / "other.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.jit.script(torch.nn.ReLU()).save(str(other))
    with pytest.raises(VisionError, match=r"does not accept a clip as i3d_torchscript\.pt does"):
        I3d.load(other).features(clips)
