"""What a renderer draws: the right thing at the right pixel, the same every time, by either renderer."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.engines.bullet import egl
from embodiedreamer_gym.engines.bullet.rendering import Renderer
from embodiedreamer_gym.envs.cameras import CAMERAS, Camera, look_at
from embodiedreamer_gym.errors import SimulationError

needs_egl = pytest.mark.skipif(not egl.is_available(), reason=f"no OpenGL without a display: install {egl.PACKAGES}")
BOTH = ["tiny", pytest.param("egl", marks=needs_egl)]
SIZES = [(640, 480), (160, 128)]
RADIUS = 0.012  # m
POINTS = np.array([(0.9, 0.0, 0.1), (0.7, 0.25, 0.0), (1.1, -0.3, 0.35), (0.6, -0.15, -0.1)])
EYE = (0.1, 0.05, 0.2)
CAMERA = Camera("eye", EYE, look_at(EYE, (1.0, 0.0, 0.1)), (640, 480), 520.0, 560.0, 270.0, 205.0, near=0.1, far=4.0)
RED, GREEN = (0.9, 0.1, 0.1, 1.0), (0.1, 0.8, 0.1, 1.0)


class World:
    """A PyBullet world, a renderer and the spheres in it."""

    def __init__(self, kind: str, points=(), **options) -> None:
        self.client = BulletClient(pybullet.DIRECT)
        self.renderer = Renderer(self.client, kind, **options)
        self.spheres = [self.sphere(point) for point in points]

    def sphere(self, point, radius: float = RADIUS, colour=RED) -> int:
        shape = self.client.createVisualShape(pybullet.GEOM_SPHERE, radius=radius, rgbaColor=colour)
        return self.client.createMultiBody(0, -1, shape, [float(x) for x in point])

    def box(self, point, half=0.1, colour=GREEN) -> int:
        shape = self.client.createVisualShape(pybullet.GEOM_BOX, halfExtents=[half] * 3, rgbaColor=colour)
        return self.client.createMultiBody(0, -1, shape, [float(x) for x in point])

    def close(self) -> None:
        self.renderer.close()
        self.client.disconnect()


@pytest.fixture(scope="module", params=BOTH)
def world(request: pytest.FixtureRequest) -> Iterator[World]:
    made = World(request.param, POINTS)
    yield made
    made.close()


def test_a_build_without_numpy_gives_the_same_frame(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """PyBullet built without numpy gives flat tuples; the arrays made of them can be written to."""
    classes = {body: 10 + i for i, body in enumerate(world.spheres)}
    expected = world.renderer.capture(CAMERA, (48, 36), None, classes)
    picture = world.renderer.rgb(CAMERA, (48, 36))
    original = world.client.getCameraImage

    def flat(*arguments, **keywords):
        width, height, *images = original(*arguments, **keywords)
        return width, height, *(tuple(np.asarray(image).ravel().tolist()) for image in images)

    monkeypatch.setattr(world.client, "getCameraImage", flat, raising=False)
    frame = world.renderer.capture(CAMERA, (48, 36), None, classes)
    assert all(np.array_equal(value, expected.as_dict()[key]) for key, value in frame.as_dict().items())
    assert np.array_equal(world.renderer.rgb(CAMERA, (48, 36)), picture)


@pytest.mark.parametrize("size", SIZES)
def test_a_point_is_drawn_where_the_lens_says(world: World, size: tuple[int, int]) -> None:
    frame = world.renderer.capture(CAMERA, size, None, {body: 10 + i for i, body in enumerate(world.spheres)})
    position, rotation = CAMERA.pose()
    for i, point in enumerate(POINTS):
        seen = rotation.T @ (point - position)
        u, v, _ = CAMERA.matrix(size) @ seen / seen[2]
        rows, columns = np.nonzero(frame.segmentation == 10 + i)
        assert np.hypot(columns.mean() - u, rows.mean() - v) < 0.4
        front = seen[2] * (1.0 - RADIUS / np.linalg.norm(seen))
        assert frame.depth[round(v), round(u)] == pytest.approx(front, abs=0.002)


def test_a_part_is_drawn_where_its_projection_says(world: World) -> None:
    """Each body as a rigid part: its middle, m in its own frame, at its pixels and its depth."""
    parts = [(body, -1) for body in world.spheres]
    frame = world.renderer.capture(CAMERA, SIZES[0], None, {body: 3 for body in world.spheres}, parts)
    assert np.array_equal(frame.parts > 0, frame.segmentation == 3)
    for number, projection in enumerate(frame.projections, 1):
        u, v, depth = projection @ (0.0, 0.0, 0.0, 1.0)
        rows, columns = np.nonzero(frame.parts == number)
        assert np.hypot(columns.mean() - u / depth, rows.mean() - v / depth) < 0.4
        assert frame.depth[round(v / depth), round(u / depth)] == pytest.approx(depth, abs=2 * RADIUS)
    without = world.renderer.capture(CAMERA, SIZES[0], None, {body: 3 for body in world.spheres})
    assert np.array_equal(without.segmentation, frame.segmentation) and not without.parts.any()


def test_what_comes_back_has_its_type(world: World) -> None:
    frame = world.renderer.capture(CAMERA, (160, 120), None, {world.spheres[0]: 7})
    assert [(a.shape, a.dtype) for a in (frame.rgb, frame.depth, frame.segmentation)] == [
        ((120, 160, 3), np.uint8), ((120, 160), np.float32), ((120, 160), np.uint8)
    ]  # fmt: skip
    assert all(a.flags.c_contiguous and a.flags.writeable for a in (frame.rgb, frame.depth, frame.segmentation))
    np.testing.assert_array_equal(world.renderer.rgb(CAMERA, (160, 120)), frame.rgb)
    assert repr(frame) == "Frame(160 x 120)"


def test_where_nothing_is_there_is_background_at_the_far_plane(world: World) -> None:
    """Bodies without a class are 0 too, but have their depth."""
    frame = world.renderer.capture(CAMERA, SIZES[0], None, {world.spheres[0]: 255})
    assert set(np.unique(frame.segmentation)) == {0, 255}
    nothing = frame.depth == np.float32(CAMERA.far)
    assert (frame.rgb[nothing] == world.renderer.light["background"]).all()
    others = ~nothing & (frame.segmentation == 0)
    assert others.sum() > 500 and (frame.depth[others] < 1.5).all()
    assert (frame.rgb[others] != world.renderer.light["background"]).any(axis=-1).all()


def test_the_same_call_gives_the_same_bits_in_arrays_of_its_own(world: World) -> None:
    classes = {body: 1 for body in world.spheres}
    one, two = (world.renderer.capture(CAMERA, SIZES[1], None, classes) for _ in range(2))
    for a, b in ((one.rgb, two.rgb), (one.depth, two.depth), (one.segmentation, two.segmentation)):
        np.testing.assert_array_equal(a, b)
        assert not np.shares_memory(a, b)
    first = world.renderer.rgb(CAMERA, SIZES[1])
    kept = first.copy()
    assert not np.shares_memory(first, world.renderer.rgb(CAMERA.with_(cx=300.0), SIZES[1]))
    np.testing.assert_array_equal(first, kept)


def test_a_camera_on_a_link_sees_what_one_standing_there_sees(world: World) -> None:
    riding = CAMERA.with_(link="hand", position=(0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.0, 1.0))
    standing = CAMERA.with_(position=(0.2, -0.1, 0.3), rotation=look_at((0.2, -0.1, 0.3), (0.8, 0.0, 0.1)))
    seen = world.renderer.rgb(riding, SIZES[1], (standing.position, standing.rotation))
    np.testing.assert_array_equal(seen, world.renderer.rgb(standing, SIZES[1]))
    assert (seen != world.renderer.rgb(CAMERA, SIZES[1])).any()
    with pytest.raises(SimulationError, match="camera eye is mounted on hand; give the pose"):
        world.renderer.rgb(riding, SIZES[1])


@pytest.mark.parametrize("kind", BOTH)
def test_a_mask_is_never_that_of_an_earlier_picture(kind: str) -> None:
    """PyBullet hands out the last mask again where it was asked for none."""
    world = World(kind)
    body = world.sphere((1.0, 0.0, 0.1), radius=0.1)
    before = world.renderer.capture(CAMERA, SIZES[1], None, {body: 1}).segmentation
    world.client.resetBasePositionAndOrientation(body, (1.0, 0.3, 0.1), (0, 0, 0, 1))
    world.renderer.rgb(CAMERA, SIZES[1])
    after = world.renderer.capture(CAMERA, SIZES[1], None, {body: 1}).segmentation
    assert before.sum() > 100 and after.sum() > 100
    assert not (before & after).any()
    world.close()


@needs_egl
def test_worlds_of_one_process_do_not_draw_into_each_other() -> None:
    """Nor does one that is loaded into, closed or forgotten meanwhile."""
    places = [(0.8, 0.0, 0.1), (1.1, 0.2, 0.0), (0.9, -0.2, 0.2)]
    alone = []
    for place in places:
        world = World("egl", [place])
        alone.append(world.renderer.rgb(CAMERA, SIZES[1]))
        world.close()
    worlds = [World("egl", [place]) for place in places]
    for _ in range(2):
        for world, picture in zip(worlds, alone, strict=True):
            np.testing.assert_array_equal(world.renderer.rgb(CAMERA, SIZES[1]), picture)
    worlds[1].renderer.activate()
    worlds[1].box((0.9, 0.0, 0.0))
    assert (worlds[1].renderer.rgb(CAMERA, SIZES[1]) != alone[1]).any()
    np.testing.assert_array_equal(worlds[2].renderer.rgb(CAMERA, SIZES[1]), alone[2])
    del worlds[1]  # while the last one's turn it is
    np.testing.assert_array_equal(worlds[1].renderer.rgb(CAMERA, SIZES[1]), alone[2])
    np.testing.assert_array_equal(worlds[0].renderer.rgb(CAMERA, SIZES[1]), alone[0])
    worlds[1].close()
    np.testing.assert_array_equal(worlds[0].renderer.rgb(CAMERA, SIZES[1]), alone[0])
    worlds[0].close()
    worlds[0].renderer.close()


@needs_egl
def test_the_renderers_differ_in_light_only() -> None:
    tiny, drawn = World("tiny", POINTS), World("egl", POINTS)
    a, b = (w.renderer.capture(CAMERA, SIZES[0], None, {w.spheres[0]: 1}) for w in (tiny, drawn))
    assert (a.segmentation != b.segmentation).mean() < 1e-3
    both = (a.depth < CAMERA.far) & (b.depth < CAMERA.far)
    assert np.median(np.abs(a.depth - b.depth)[both]) < 1e-3
    assert tiny.renderer.light != drawn.renderer.light
    tiny.close()
    drawn.close()


def test_metadata_is_fit_for_json_and_nobodys_own(world: World) -> None:
    light = world.renderer.light
    assert json.loads(json.dumps(light)) == light
    light["position"].append(1.0)
    light["ambient"] = 2.0
    assert world.renderer.light != light
    assert world.renderer.name in ("tiny", "egl")


# ---- the choice of a renderer ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "name"), [((128, 96), "tiny"), ((128, 128), "tiny"), ((224, 224), "egl"), ((1600, 1200), "tiny")])  # fmt: skip
@needs_egl
def test_auto_takes_opengl_for_pictures_that_it_draws_faster(size: tuple[int, int], name: str) -> None:
    world = World("auto", size=size)
    assert world.renderer.name == name
    world.close()


def test_without_a_driver_auto_is_tiny_and_egl_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(egl, "is_available", lambda: False)
    assert World("auto", size=(640, 480)).renderer.name == "tiny"
    with pytest.raises(SimulationError, match="libegl1 libegl-mesa0 libgl1-mesa-dri, or use 'tiny'"):
        World("egl")


@needs_egl
def test_a_driver_that_is_missing_does_not_end_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent")
    assert not egl.is_available.__wrapped__()
    monkeypatch.setattr(egl, "plugin_path", lambda: None)
    assert not egl.is_available.__wrapped__()


@needs_egl
def test_opengl_refuses_what_it_would_draw_wrongly() -> None:
    client = BulletClient(pybullet.DIRECT)
    client.createMultiBody(0)
    with pytest.raises(SimulationError, match="1 bodies that renderer 'egl' would not draw; make the renderer first"):
        Renderer(client, "egl")
    world = World("egl")
    with pytest.raises(SimulationError, match="up to 1024 x 768 pixels, not 1280 x 720"):
        world.renderer.rgb(CAMERA, (1280, 720))
    world.renderer.close()
    with pytest.raises(SimulationError, match="renderer 'egl' is closed"):
        world.renderer.rgb(CAMERA, SIZES[1])
    world.close()


@needs_egl
def test_opengl_says_nothing(capfd: pytest.CaptureFixture) -> None:
    world = World("egl", POINTS)
    world.renderer.rgb(CAMERA, SIZES[1])
    world.close()
    printed = "".join(capfd.readouterr())
    assert "EGL" not in printed and "GL_" not in printed and "Mesa" not in printed


def test_other_mistakes_are_named(world: World) -> None:
    with pytest.raises(SimulationError, match="renderer 'vulkan' is not one of 'auto', 'tiny', 'egl'"):
        Renderer(world.client, "vulkan")
    with pytest.raises(SimulationError, match=r"class 256 of body 0 is not one of 0 \.\. 255"):
        world.renderer.capture(CAMERAS["head"], (64, 48), None, {0: 256})
