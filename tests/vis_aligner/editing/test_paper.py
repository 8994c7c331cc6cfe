"""A sheet of A4 where the camera sees it, under robot and objects."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE, TABLE_HEIGHT
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.vis_aligner.editing import PaperSheet, apply, draws_of

SIZE = (320, 240)
BROWN = np.full((SIZE[1], SIZE[0], 3), (120, 90, 60), np.uint8)
ABOVE = Camera.from_fov("above", (0.6, 0.0, 1.74), look_at((0.6, 0.0, 1.74), (0.6, 0.0, 0.74), (1.0, 0.0, 0.0)), 60.0)


def scene(**things: tuple[slice, slice]) -> dict[str, np.ndarray]:
    found = {name: np.zeros(BROWN.shape[:2], bool) for name in ("background", "table", "robot", "cup")}
    for name, where in things.items():
        found[name][where] = True
    found["table"] = ~np.any(list(found.values()), axis=0)
    return found


def sheet(image: np.ndarray) -> np.ndarray:
    return image[..., 2] > 150


def test_it_lies_on_the_table_of_the_environments() -> None:
    editor = PaperSheet(CAMERAS["head"])
    assert editor.height == TABLE_HEIGHT
    reach = 0.5 * np.hypot(*editor.size)
    for (low, high), middle, side in zip(editor.area, TABLE_CENTRE, TABLE.size, strict=False):
        assert middle - side / 2 + reach <= low and high <= middle + side / 2 - reach


def test_corners_are_where_the_camera_says() -> None:
    """Straight from above at 1 m: pixels are metres times the focal length, x up and y to the left."""
    editor = PaperSheet(ABOVE, pose=(0.65, 0.1, 0.3))
    found = editor.corners(0.65, 0.1, 0.3, BROWN)
    focal = 120 / np.tan(np.radians(30))
    x, y = 0.6 - (found[:, 1] - 119.5) / focal, -(found[:, 0] - 159.5) / focal
    assert (x.mean(), y.mean()) == pytest.approx((0.65, 0.1))
    sides = np.hypot(np.diff(x, append=x[0]), np.diff(y, append=y[0]))
    assert sides == pytest.approx([0.297, 0.210, 0.297, 0.210])
    assert np.arctan2(y[1] - y[0], x[1] - x[0]) == pytest.approx(0.3)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_white_is_the_projected_sheet(seed: int) -> None:
    editor = PaperSheet(CAMERAS["head"])
    drawn = draws_of(editor, scene(), seed)
    corners = editor.corners(drawn["x"], drawn["y"], drawn["turn"], BROWN)
    wanted = np.zeros(BROWN.shape[:2], np.uint8)
    cv2.fillConvexPoly(wanted, np.round(corners).astype(np.int32), 1)
    found = sheet(apply(editor, BROWN, scene(), seed))
    assert (found & (wanted > 0)).sum() / (found | (wanted > 0)).sum() > 0.9 and found.sum() > 200


def test_robot_and_objects_lie_on_it() -> None:
    things = scene(robot=(slice(100, 120), slice(None)), cup=(slice(125, 135), slice(150, 170)))
    done = apply(PaperSheet(CAMERAS["head"], pose=(0.6, 0.0, 0.0)), BROWN, things, 0)
    covered = things["robot"] | things["cup"]
    whole = sheet(apply(PaperSheet(CAMERAS["head"], pose=(0.6, 0.0, 0.0)), BROWN, scene(), 0))
    assert (whole & things["cup"]).any() and (whole & things["robot"]).any()
    assert np.array_equal(done[covered], BROWN[covered]) and np.array_equal(sheet(done), whole & ~covered)


def test_it_is_in_the_tables_light() -> None:
    lit = BROWN.copy()
    lit[:, :160] = lit[:, :160] * 0.7
    done = apply(PaperSheet(CAMERAS["head"], pose=(0.6, 0.0, 0.0)), lit, scene(), 0)
    white = np.nonzero(apply(PaperSheet(CAMERAS["head"], pose=(0.6, 0.0, 0.0)), BROWN, scene(), 0)[..., 2] > 200)
    left, right = (done[r, c, 0].astype(float) for r, c in (
        (white[0][white[1] < 150], white[1][white[1] < 150]), (white[0][white[1] > 170], white[1][white[1] > 170])))  # fmt: skip
    assert left.mean() / right.mean() == pytest.approx(0.7, abs=0.05)


def test_what_cannot_be() -> None:
    with pytest.raises(VisionError, match="is mounted on left_link6"):
        PaperSheet(CAMERAS["left_wrist"])
    with pytest.raises(VisionError, match="does not see a sheet"):
        apply(PaperSheet(ABOVE, height=2.0), BROWN, scene(), 0)
