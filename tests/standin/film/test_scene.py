"""A scene for Blender is whole, and its camera the environment's."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.standin.film.appearance_library import draw_appearance
from embodiedreamer_gym.standin.film.blender import SENSOR, camera_spec
from embodiedreamer_gym.standin.film.geometry import Part, box
from embodiedreamer_gym.standin.film.lab import lab
from embodiedreamer_gym.standin.film.materials import linear
from embodiedreamer_gym.standin.film.play import EpisodePlayer
from embodiedreamer_gym.standin.film.scene import Animation, make_scene, room_parts

EYE = (0.1, 0.05, 0.2)
CAMERAS_OF_ALL_KINDS = [
    CAMERAS["head"],
    CAMERAS["head"].with_(size=(321, 200), cx=100.0, cy=130.0),
    Camera("wide", EYE, look_at(EYE, (1.0, 0.0, 0.1)), (640, 480), 520.0, 560.0, 270.0, 205.0),
    Camera("tall", EYE, look_at(EYE, (1.0, 0.0, 0.1)), (90, 160), 95.0, 81.0, 50.5, 71.0),
]


def shown(spec: dict, size: tuple[int, int], point: np.ndarray) -> tuple[float, float]:
    """Where Blender draws a point: column and row, the middle of the first pixel being 0, 0.

    Source: BKE_camera_params_compute_viewplane of Blender's camera.cc, with a sensor fitted horizontally.
    """
    pose = np.array(spec["pose"])
    seen = pose[:3, :3].T @ (point - pose[:3, 3])
    (width, height), (x_aspect, y_aspect) = size, spec["aspect"]
    ratio = y_aspect / x_aspect
    pixel = SENSOR / spec["lens"] / width
    left = (-0.5 * width + spec["shift"][0] * width) * pixel
    bottom = (-0.5 * ratio * height + spec["shift"][1] * width) * pixel
    x, y = seen[0] / -seen[2], seen[1] / -seen[2]
    return (x - left) / pixel - 0.5, height - (y - bottom) / (pixel * ratio) - 0.5


@pytest.mark.parametrize("camera", CAMERAS_OF_ALL_KINDS, ids=lambda camera: f"{camera.name} {camera.size[0]}")
def test_blenders_camera_draws_points_where_the_lens_says(camera: Camera) -> None:
    position, rotation = camera.pose()
    for ahead in ([0.1, -0.2, 1.0], [-0.4, 0.3, 1.2], [0.0, 0.0, 0.7]):
        u, v, _ = camera.matrix() @ ahead / ahead[2]
        spec = camera_spec(camera)
        np.testing.assert_allclose(shown(spec, camera.size, position + rotation @ ahead), (u, v), atol=1e-9)
        assert min(spec["aspect"]) == 1.0


def test_a_scene_is_whole(stage: EpisodePlayer) -> None:
    poses = np.tile(np.eye(4), (3, len(stage.links) + 2, 1, 1))
    take = Animation(stage.parts, (*stage.links, *stage.props), poses)
    for appearance in (lab(), draw_appearance(5)):
        scene = make_scene(take, appearance, CAMERAS["head"], 4)
        assert scene == json.loads(json.dumps(scene))
        assert len(scene["frames"]) == 3 and {len(frame) for frame in scene["frames"]} == {len(scene["moving"])}
        assert {part["material"] for part in scene["parts"]} == set(scene["materials"])
        assert {part["body"] for part in scene["parts"]} == {None, *scene["moving"]}
        assert {part["number"] for part in scene["parts"]} == {0, 1, 2, 3, 4}
        assert scene["sky"]["strength"] > 0 and len(scene["lamps"]) == len(appearance.lamps)
        assert make_scene(take, appearance, CAMERAS["head"], 4, classes=True)["sky"]["strength"] == 0.0


def test_lamps_shine_at_what_they_appearance_at() -> None:
    appearance = lab()
    part = Part("cube", 3, "cup", *box((0.1, 0.1, 0.1)))
    scene = make_scene(Animation([part], ("cube",), np.eye(4)[None, None]), appearance, CAMERAS["head"])
    for lamp, made in zip(appearance.lamps, scene["lamps"], strict=True):
        pose = np.array(made["pose"])
        np.testing.assert_allclose(pose[:3, 3], lamp.position)
        way = np.subtract(lamp.target, lamp.position)
        np.testing.assert_allclose(-pose[:3, 2], way / np.linalg.norm(way), atol=1e-9)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(pose) == pytest.approx(1.0)


def test_things_that_would_stand_in_the_wall_are_left_out() -> None:
    appearances = [draw_appearance(seed) for seed in range(60)]
    for appearance in appearances:
        parts = [part for part in room_parts(appearance) if part.material in ("cabinet", "carton", "crate")]
        assert len(parts) <= len(appearance.blocks)
        for part in parts:
            ahead = part.points @ [np.cos(appearance.turn), np.sin(appearance.turn), 0.0]
            assert ahead.max() < appearance.wall + 0.35
    assert sum(len(room_parts(appearance)) < 9 + len(appearance.blocks) for appearance in appearances) > 0


def test_a_thing_no_appearance_knows_has_the_simulators_colour() -> None:
    part = Part("duck", 3, "duck", *box((0.1, 0.1, 0.1)), colour=(0.9, 0.8, 0.1))
    take = Animation([part], ("duck",), np.eye(4)[None, None])
    nodes = make_scene(take, lab(), CAMERAS["head"])["materials"]["duck"]
    ramp = next(settings["ramp"] for _, settings, _ in nodes if "ramp" in settings)
    assert ramp[0][1][0] == pytest.approx(0.92 * linear(0.9)) and ramp[0][1][2] < 0.02
