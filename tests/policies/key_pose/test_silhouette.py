"""Poses of things of known shape from the probabilities of their pixels."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.engines.table import TABLE_HEIGHT
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.policies.key_pose.frames import folded
from embodiedreamer_gym.policies.key_pose.silhouette import View, fitted, is_round

VIEW = View(CAMERAS["head"], (128, 96))
SHAPES = {
    prop.name: np.concatenate([shape.corners() for shape in prop.shapes]) + np.array([0.0, 0.0, TABLE_HEIGHT])
    for task in TASKS.values()
    for prop in task().props
}


def shares(name: str, pose: tuple[float, float, float], low: float = 0.002) -> np.ndarray:
    """Probabilities (H, W) of a thing that is seen as it is."""
    found = np.full(VIEW.size[::-1], low, np.float32)
    inside, rows, columns = VIEW.outline(SHAPES[name], pose)
    found[rows, columns] = np.maximum(0.98 * inside, low)
    return found


def test_corners_are_those_of_the_prop() -> None:
    for task in TASKS.values():
        for prop in task().props:
            points = np.concatenate([shape.corners() for shape in prop.shapes])
            assert np.allclose(np.ptp(points, axis=0), prop.size, atol=2e-3), prop.name
            assert abs(points[:, 2].min()) < 1e-9


def test_round_things_are_known() -> None:
    assert {name for name, shape in SHAPES.items() if is_round(shape)} == {"cup", "mat", "holder"}


@pytest.mark.parametrize("name", ["pen", "remote", "box", "holder"])
def test_a_thing_is_found_from_a_start_beside_it(name: str) -> None:
    for pose in ((0.48, 0.25, 0.4), (0.52, -0.3, 2.0)):
        found = fitted(shares(name, pose), SHAPES[name], VIEW, (pose[0] + 0.015, pose[1] - 0.01, pose[2] + 0.2))
        assert np.hypot(found[0] - pose[0], found[1] - pose[1]) < 0.003
        assert is_round(SHAPES[name]) or abs(np.degrees(folded(found[2] - pose[2]))) < 2.0


def test_a_box_is_found_from_the_wrong_orientation() -> None:
    pose = (0.5, 0.3, 0.3)
    found = fitted(shares("box", pose), SHAPES["box"], VIEW, (*pose[:2], pose[2] + 1.5))
    assert abs(np.degrees(folded(found[2] - pose[2]))) < 3.0


def test_faint_parts_count() -> None:
    """Where only the pen's cap is sure and its body hardly more probable than the table, the pen is found all the same."""
    pose = (0.48, 0.28, 0.5)
    seen = shares("pen", pose)
    rows, columns = np.nonzero(seen > 0.1)
    matrix = VIEW.pixels(np.array([[pose[0] + s * np.cos(0.5), pose[1] + s * np.sin(0.5), TABLE_HEIGHT] for s in (0.0, -0.07)]))  # fmt: skip
    along = (np.stack([columns, rows], 1) - matrix[0]) @ (matrix[1] - matrix[0])
    faint = along < 0.4 * ((matrix[1] - matrix[0]) ** 2).sum()
    seen[rows[faint], columns[faint]] = 0.2
    cap = pose[0] - 0.055 * np.cos(0.5), pose[1] - 0.055 * np.sin(0.5), 0.5
    found = fitted(seen, SHAPES["pen"], VIEW, cap)
    assert np.hypot(cap[0] - pose[0], cap[1] - pose[1]) > 0.05
    assert np.hypot(found[0] - pose[0], found[1] - pose[1]) < 0.02
