"""Cameras: their geometry, what the built-in ones see, and the files of calibrated ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.envs.cameras import CAMERAS, Camera, load_cameras, look_at, save_cameras
from embodiedreamer_gym.errors import ModelError, SimulationError

TABLE = 0.74  # m
SIZE = (640, 480)
TURN = (0.0, 0.0, 0.6, 0.8)  # about z by 2 atan(3/4)
ENTRY = {
    "position": [0.1, 0.2, 0.3], "rotation": [0, 0, 0, 1], "size": [640, 480],
    "fx": 600, "fy": 610, "cx": 318.5, "cy": 241.0,
}  # fmt: skip


def pixels(camera: Camera, points, size=SIZE, pose=None) -> np.ndarray:
    """Where the points (N, 3) of the world are drawn (N, 2); nan behind the camera."""
    position, rotation = camera.pose(pose)
    seen = (np.atleast_2d(points) - position) @ rotation
    drawn = seen @ camera.matrix(size).T
    return np.where(seen[:, 2:] > camera.near, drawn[:, :2] / drawn[:, 2:], np.nan)


def inside(camera: Camera, points, size=SIZE, pose=None) -> np.ndarray:
    drawn = pixels(camera, points, size, pose)
    return ((drawn > -0.5) & (drawn < np.array(size) - 0.5)).all(axis=1)


def corners(*ranges) -> np.ndarray:
    return np.stack(np.meshgrid(*ranges), axis=-1).reshape(-1, 3)


def test_the_head_camera_sees_the_work_area_and_the_grippers_above_it() -> None:
    area = corners((0.30, 0.70), (-0.45, 0.45), (TABLE,))
    above = corners((0.40, 0.70), (-0.42, 0.42), (TABLE + 0.2,))
    at_home = corners((0.62, 0.77), (-0.37, 0.37), (1.13, 1.16))  # wrists to finger tips, fingers apart
    for size in (SIZE, (128, 96), (224, 168)):
        assert inside(CAMERAS["head"], np.vstack([area, above, at_home]), size).all()


def test_the_head_camera_shows_left_on_the_left_and_far_above_near() -> None:
    left, right, near, far = pixels(CAMERAS["head"], [(0.5, 0.2, TABLE), (0.5, -0.2, TABLE), (0.35, 0, TABLE), (0.7, 0, TABLE)])  # fmt: skip
    assert left[0] < right[0] and far[1] < near[1]
    assert near[0] == far[0] == pytest.approx(319.5)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_wrist_camera_sees_the_fingers_and_what_is_between_them(side: str) -> None:
    camera = CAMERAS[f"{side}_wrist"]
    assert camera.link == f"{side}_link6"
    link = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    tips = corners((-0.011, 0.011), (-0.045, 0.045), (0.11, 0.14))  # in the link's frame, fingers apart
    between = corners((-0.02, 0.02), (-0.035, 0.035), (0.11, 0.40))
    assert inside(camera, np.vstack([tips, between]), pose=link).all()


def test_a_camera_goes_where_its_link_goes() -> None:
    camera = Camera.from_fov("c", (0.1, 0.0, 0.2), look_at((0, 0, 0), (1, 0, 0)), 60.0, link="hand")
    position, rotation = camera.pose(((1.0, 2.0, 3.0), TURN))
    turned = np.array([[0.28, -0.96, 0.0], [0.96, 0.28, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(position, [1.028, 2.096, 3.2])
    np.testing.assert_allclose(rotation[:, 2], turned[:, 0], atol=1e-12)
    with pytest.raises(SimulationError, match="is mounted on hand"):
        camera.view()


def test_another_size_shows_the_same_view() -> None:
    """As if the picture were resized: its edges stay where they are, half a pixel outside the outer pixels' middles."""
    camera = Camera("c", (0, 0, 0), (0, 0, 0, 1), (640, 480), 500.0, 510.0, 300.0, 250.0)
    edge = np.array([(-0.5 - 300.0) / 500.0, (479.5 - 250.0) / 510.0, 1.0])
    np.testing.assert_allclose(camera.matrix() @ edge, [-0.5, 479.5, 1.0])
    np.testing.assert_allclose(camera.matrix((224, 100)) @ edge, [-0.5, 99.5, 1.0])


def test_a_field_of_view_spans_the_picture() -> None:
    camera = Camera.from_fov("c", (0, 0, 0), (0, 0, 0, 1), 90.0, size=(200, 100))
    np.testing.assert_allclose(camera.matrix() @ [0.0, 1.0, 1.0], [99.5, 99.5, 1.0])
    assert camera.fx == camera.fy == pytest.approx(50.0)


def test_look_at_stands_the_picture_upright() -> None:
    camera = Camera.from_fov("c", (1, 1, 1), look_at((1, 1, 1), (3, 2, 0.5)), 50.0)
    target, above = pixels(camera, [(3, 2, 0.5), (3, 2, 0.6)])
    np.testing.assert_allclose(target, [319.5, 239.5])
    assert above[0] == pytest.approx(319.5) and above[1] < 239.5
    with pytest.raises(ModelError, match="cannot look along 'up'"):
        look_at((0, 0, 1), (0, 0, 0))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"position": (0.0, float("nan"), 0.0)}, "position needs 3 finite numbers"),
        ({"rotation": (0.0, 0.0, 0.0)}, "rotation needs 4 finite numbers"),
        (
            {"rotation": (0.0, 0.0, 0.0, 2.0)},
            "rotation must be a quaternion x, y, z, w of length 1, but its length is 2",
        ),
        ({"fx": 0.0}, "fx is 0.0, not above 0"),
        ({"fy": float("nan")}, "fy is nan"),
        ({"cx": float("inf")}, "cx is inf, not a finite number"),
        ({"near": 5.0}, "near .5.0 m. is not below far .5.0 m."),
        ({"size": (640, 0)}, "two whole numbers above 0"),
        ({"size": (640.5, 480)}, "two whole numbers above 0"),
    ],
)
def test_values_that_are_no_cameras_are_refused(change: dict, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        CAMERAS["head"].with_(**change)


def test_an_almost_unit_quaternion_is_made_one() -> None:
    camera = CAMERAS["head"].with_(rotation=(0.0, 0.0, 0.0, 1.001))
    assert camera.rotation == (0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("fovy", [0.0, 180.0, float("nan")])
def test_an_impossible_field_of_view_is_refused(fovy: float) -> None:
    with pytest.raises(ModelError, match="between 0 and 180"):
        Camera.from_fov("c", (0, 0, 0), (0, 0, 0, 1), fovy)


def test_a_file_holds_cameras_as_they_are(tmp_path: Path) -> None:
    save_cameras(CAMERAS, tmp_path / "cameras.json")
    assert load_cameras(tmp_path / "cameras.json") == dict(CAMERAS)
    assert [p.name for p in tmp_path.iterdir()] == ["cameras.json"]
    with pytest.raises(ModelError, match="two cameras have the same name"):
        save_cameras([CAMERAS["head"], CAMERAS["head"]], tmp_path / "cameras.json")


def test_numbers_of_numpy_are_saved_too(tmp_path: Path) -> None:
    camera = CAMERAS["head"].with_(
        fx=np.float32(500.0), position=np.float32([0, 1, 2]), size=(np.int64(64), np.int64(48))
    )
    save_cameras([camera], tmp_path / "c.json")
    assert load_cameras(tmp_path / "c.json")["head"] == camera


def write(path: Path, entry) -> Path:
    path.write_text(json.dumps({"cameras": {"head": entry}}))
    return path


def test_a_file_may_leave_out_link_near_and_far(tmp_path: Path) -> None:
    camera = load_cameras(write(tmp_path / "c.json", ENTRY))["head"]
    assert (camera.link, camera.near, camera.far) == (None, 0.05, 5.0)
    assert camera.name == "head" and camera.size == (640, 480) and camera.fy == 610


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ({k: v for k, v in ENTRY.items() if k != "fx"}, "camera head: key 'fx' is missing"),
        ({**ENTRY, "fovy": 55}, "camera head: unknown key 'fovy'; known keys: position, rotation"),
        ({**ENTRY, "fx": float("nan")}, "camera head: fx is nan"),
        ({**ENTRY, "fx": "600"}, 'camera head: fx must be a number, not "600"'),
        ({**ENTRY, "position": [1, 2, None]}, "camera head: position must be a list of numbers"),
        ({**ENTRY, "link": 3}, "camera head: link must be the name of a link, or null"),
        ([1, 2], "camera head: must be an object with the keys position"),
    ],
)
def test_a_files_mistakes_are_named(tmp_path: Path, entry, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence) as raised:
        load_cameras(write(tmp_path / "c.json", entry))
    assert "c.json" in str(raised.value) and str(raised.value).count("\n") == 0


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"cameras": {}}', '{"cameras": [], "x": 1}'])
def test_a_file_without_cameras_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(ModelError, match=r"camera file .*c\.json"):
        load_cameras(tmp_path / "c.json")
