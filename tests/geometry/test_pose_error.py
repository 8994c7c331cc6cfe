"""Errors of a trajectory against their definition, forward kinematics against two other computations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.geometry.pose_error import rotation_error, trajectory_error, translation_error


def test_translation_error_is_the_mean_distance() -> None:
    moved = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
    assert translation_error(moved, np.zeros((2, 3))) == pytest.approx(3.0)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.5, 2.0, np.pi])
def test_rotation_error_is_half_the_angle(angle: float) -> None:
    rng = np.random.default_rng(0)
    reference = Rotation.random(8, rng=rng)
    axes = rng.normal(size=(8, 3))
    turn = Rotation.from_rotvec(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))
    turned = turn * reference
    # arcsin is steep near 1: rounding of 1e-16 in the matrix becomes 1e-8 rad at half a turn
    assert rotation_error(turned.as_matrix(), reference.as_matrix()) == pytest.approx(angle / 2, abs=1e-7)
    assert (turned * reference.inv()).magnitude() / 2 == pytest.approx(angle / 2)


def test_trajectory_error_is_the_sum() -> None:
    reference = (np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    turned = Rotation.from_euler("x", np.full((4, 1), 0.2)).as_matrix()
    moved = (np.full((4, 3), 0.1), turned)
    assert trajectory_error(moved, reference) == pytest.approx(0.1 * np.sqrt(3) + 0.1)
    assert trajectory_error(reference, reference) == 0.0


@pytest.mark.parametrize("shapes", [((4, 3), (5, 3)), ((4, 2), (4, 2)), ((0, 3), (0, 3)), ((3,), (3,))])
def test_positions_that_do_not_fit_are_refused(shapes: tuple[tuple[int, ...], tuple[int, ...]]) -> None:
    with pytest.raises(ModelError, match="must be"):
        translation_error(np.zeros(shapes[0]), np.zeros(shapes[1]))
