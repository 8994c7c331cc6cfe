"""The search from nothing: patterns in space and time."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.geometry.articulated_mesh import DetailLevels
from embodiedreamer_gym.vis_aligner.camera_calibration import search as searching
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Observations, bounding_sphere, observe
from embodiedreamer_gym.vis_aligner.camera_calibration.search import Matcher, search
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View
from tests.vis_aligner.camera_calibration.conftest import SIZE, TRUTH, Bench, apart, motion, surface


@pytest.fixture(scope="module")
def scene(bench: Bench) -> Observations:
    return observe(bench.footage(masks=bench.masks), surface().body, SIZE)


@pytest.fixture(scope="module")
def matcher(scene: Observations) -> Matcher:
    body = DetailLevels.of(surface().body, 0.5).coarse
    return Matcher(scene, body, scene.vertices(body, few=True))


def turned(pan: float, tilt: float) -> View:
    change = np.zeros(11)
    change[:2] = tilt, pan
    return View.from_camera(TRUTH).updated(change)


def test_the_true_view_matches(matcher: Matcher) -> None:
    score, view = matcher.match(View.from_camera(TRUTH))
    assert score > 0.9
    assert apart(view.camera("c"), TRUTH, motion()) < 3.0  # half a cell


@pytest.mark.parametrize(("pan", "tilt"), [(0.25, 0.0), (0.0, -0.2), (-0.2, 0.15)])
def test_a_turned_view_is_turned_back(matcher: Matcher, pan: float, tilt: float) -> None:
    away = turned(pan, tilt)
    assert apart(away.camera("c"), TRUTH, motion()) > 25.0
    score, view = matcher.match(away)
    assert score > 0.7
    assert apart(view.camera("c"), TRUTH, motion()) < 8.0


def test_another_place_matches_less(matcher: Matcher) -> None:
    truth = View.from_camera(TRUTH)
    behind = View.from_pose(np.array([-0.6, -0.6, 1.4]), truth.rotation * [[-1], [1], [-1]], truth.fx, SIZE)
    assert matcher.match(behind)[0] < matcher.match(truth)[0] - 0.3


def test_a_search_ends_near_the_truth(matcher: Matcher, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "TRIED", 256)
    middle, radius = bounding_sphere(surface().body, surface().poses(motion()))
    told: list[str] = []
    report = lambda stage, count, total, **named: told.append(stage)  # noqa: E731
    views = search(matcher, SIZE, middle, radius, np.random.default_rng(0), TRUTH.fx, report=report)
    again = search(matcher, SIZE, middle, radius, np.random.default_rng(0), TRUTH.fx)
    assert len(views) == 256 and set(told) == {"search"}
    np.testing.assert_array_equal(views[0].translation, again[0].translation)
    best = min(apart(view.camera("c"), TRUTH, motion()) for view in views[:8])
    assert best < 25.0
    assert all(view.fx == TRUTH.fx for view in views)
