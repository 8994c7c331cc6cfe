"""Silhouettes fitted as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.geometry.articulated_mesh import DetailLevels
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import observe
from embodiedreamer_gym.vis_aligner.camera_calibration.silhouette import Silhouette
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View
from tests.vis_aligner.camera_calibration.conftest import SIZE, TRUTH, Bench, apart, motion, surface


@pytest.fixture(scope="module")
def shape(bench: Bench) -> Silhouette:
    scene = observe(bench.footage(masks=bench.masks), surface().body, SIZE)
    return Silhouette(scene, DetailLevels.of(surface().body, 0.5))


def test_the_truth_scores_best(shape: Silhouette) -> None:
    truth = View.from_camera(TRUTH)
    assert shape.score(truth) > 0.97
    for k in range(6):
        change = np.zeros(11)
        change[k] = 0.05
        assert shape.score(truth.updated(change)) < shape.score(truth)


def test_a_guess_comes_nearer(shape: Silhouette, near: Camera) -> None:
    before = apart(near, TRUTH, motion())
    view = shape.fit(View.from_camera(near), ("focal",))
    assert before > 10.0
    assert apart(view.camera("c"), TRUTH, motion()) < 3.0


def test_what_is_loose_does_not_count(bench: Bench) -> None:
    """A robot with another gripper: with the gripper loose the true view scores as it should."""
    masks = bench.masks.copy()
    names = [name for name in surface().body.names if "finger" in name or "gripper" in name or "link6" in name]
    scene = observe(bench.footage(masks=masks), surface().body, SIZE)
    rigid, loose = (Silhouette(scene, DetailLevels.of(surface().body, 0.5, given, 0.05)) for given in ((), names))
    truth = View.from_camera(TRUTH)
    assert loose.score(truth) > 0.9 and rigid.score(truth) > 0.9
    away = truth.updated(np.r_[0.0, 0.2, np.zeros(9)])
    assert loose.score(away) < 0.8
