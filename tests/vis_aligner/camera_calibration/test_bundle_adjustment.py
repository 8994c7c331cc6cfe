"""Least squares over views that share a lens."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.geometry.articulated_mesh import DetailLevels
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.vis_aligner.camera_calibration.bundle_adjustment import (
    State,
    build,
    bundle_adjust,
    covariance,
    edge_support,
    match,
)
from embodiedreamer_gym.vis_aligner.camera_calibration.footage import Observations, observe
from embodiedreamer_gym.vis_aligner.camera_calibration.view import View
from tests.vis_aligner.camera_calibration.conftest import SIZE, TRUTH, Bench, apart, marks_of, motion, surface


@pytest.fixture(scope="module")
def levels() -> DetailLevels:
    return DetailLevels.of(surface().body, 0.5)


@pytest.fixture(scope="module")
def scene(bench: Bench) -> Observations:
    return observe(bench.footage(), surface().body, SIZE)


def state_of(camera: Camera, delay: float = 0.0) -> State:
    return State((View.from_camera(camera),), delay)


def test_views_move_until_the_outlines_lie_on_the_robot(
    levels: DetailLevels, scene: Observations, near: Camera
) -> None:
    told: list[int] = []
    report = lambda stage, count, **named: told.append(count)  # noqa: E731
    state = bundle_adjust(levels, [[scene]], state_of(near), ("focal", "aspect"), state_of(TRUTH), report=report)
    assert apart(near, TRUTH, motion()) > 8.0
    assert apart(state.views[0].camera("c"), TRUTH, motion()) < 0.6
    assert state.views[0].fx == pytest.approx(TRUTH.fx, rel=0.03) and told == sorted(told)


def test_support_is_greatest_at_the_truth(levels: DetailLevels, scene: Observations, near: Camera) -> None:
    here, there = (edge_support(match(levels, [scene], 0, state_of(c), 5.0)) for c in (TRUTH, near))
    assert here > 2 * there > 0


def test_a_delay_is_found(levels: DetailLevels, bench: Bench) -> None:
    """Pictures of the rows before: the film was shot half a row later than the log says."""
    poses = bench.footage().poses
    moved = poses.copy()
    moved[1:] = 0.5 * (poses[1:] + poses[:-1])  # where the robot will have been, half a row before each picture
    scene = observe(bench.footage(poses=np.concatenate([moved[1:], poses[-1:]])), surface().body, SIZE)
    free = ("delay",)
    state = bundle_adjust(levels, [[scene]], state_of(TRUTH), free, state_of(TRUTH))
    assert state.delay == pytest.approx(0.5, abs=0.15)
    assert apart(state.views[0].camera("c"), TRUTH, motion()) < 1.0


def test_marks_pull_too(levels: DetailLevels, near: Camera) -> None:
    marks = marks_of(TRUTH, motion(), 10)
    state = bundle_adjust(levels, [[]], state_of(near), ("focal",), state_of(near), marks, rounds=30)
    assert apart(state.views[0].camera("c"), TRUTH, motion()) < 0.2


def test_a_lens_unknown_to_the_data_stays_where_it_was(levels: DetailLevels, scene: Observations, near: Camera) -> None:
    state = bundle_adjust(levels, [[scene]], state_of(near), (), state_of(near))
    assert (state.views[0].fx, state.views[0].fy) == (near.fx, near.fy)


def test_the_covariance_covers_what_noise_does(levels: DetailLevels, scene: Observations) -> None:
    state = bundle_adjust(levels, [[scene]], state_of(TRUTH), ("focal",), state_of(TRUTH), reach=0.02)
    normal = build(match(levels, [scene], 0, state, 5.0), state, ("focal",), None, state_of(TRUTH), 1.0)
    spread = np.sqrt(np.diag(covariance(normal)))
    away = np.linalg.norm(state.views[0].position - np.array(TRUTH.position))
    assert spread.shape == (7,) and 0 < spread[0] < 0.05
    assert away < 6 * np.linalg.norm(spread[4:]) + 0.01


def test_two_stands_have_two_poses_and_one_lens() -> None:
    first, second = View.from_camera(TRUTH), View.from_camera(TRUTH.with_(position=(1.0, 0.0, 1.0)))
    change = np.zeros(2 + 12)
    change[:2] = 0.1, 0.3
    change[2 + 3], change[2 + 6 + 5] = 0.02, -0.04
    state = State((first, second)).updated(change, ("focal", "delay"))
    assert state.views[0].fx == state.views[1].fx == pytest.approx(TRUTH.fx * np.exp(0.1)) and state.delay == 0.3
    np.testing.assert_allclose(state.views[0].translation - first.translation, [0.02, 0, 0], atol=1e-12)
    np.testing.assert_allclose(state.views[1].translation - second.translation, [0, 0, -0.04], atol=1e-12)
