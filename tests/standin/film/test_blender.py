"""Blender in a process of its own: what it draws lies where the simulator draws it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.envs.cameras import CAMERAS, Camera, look_at
from embodiedreamer_gym.errors import MissingExtraError, SimulationError
from embodiedreamer_gym.standin.film.blender import STUDIO, VARIABLE, Studio, find_blender, render
from embodiedreamer_gym.standin.film.geometry import Part, sphere
from embodiedreamer_gym.standin.film.lab import lab
from embodiedreamer_gym.standin.film.play import EpisodePlayer
from embodiedreamer_gym.standin.film.scene import Animation, make_scene
from tests.standin.film.grey import fake_blender, fake_python, needs_bpy, overlap, resized

SCENE = {"size": [4, 2], "frames": [[], [], []]}
EYE = (0.5, 0.0, 1.5)
ASKEW = Camera("eye", EYE, look_at(EYE, (0.75, 0.05, 0.8)), (100, 80), 85.0, 98.0, 40.0, 47.0)
POINTS = np.array([(0.6, 0.1, 0.9), (0.8, -0.1, 0.85), (0.7, 0.25, 1.0), (0.85, 0.15, 0.95)])


# ---- without Blender -----------------------------------------------------------------------------------------------


def test_a_python_without_bpy_gets_the_line_that_installs_it(tmp_path: Path) -> None:
    python = fake_python(tmp_path / "python", "3 11 False")
    with pytest.raises(MissingExtraError, match=f"run: {python} -m pip install --no-deps 'bpy>=5.0.1,<6'"):
        find_blender(python)


def test_another_version_of_python_hears_that_there_are_wheels_for_one_only(tmp_path: Path) -> None:
    python = fake_python(tmp_path / "python", "3 13 False")
    with pytest.raises(
        MissingExtraError, match=r"wheels for Python 3\.11 only, and .* is 3\.13; .* --blender ENV/bin/python"
    ):
        next(render(SCENE, python))


@pytest.mark.parametrize("name", ["nowhere", "silent"])
def test_what_is_no_python_is_named(tmp_path: Path, name: str) -> None:
    if name == "silent":
        fake_python(tmp_path / "silent", "")
    with pytest.raises(SimulationError, match=f"{name} is not a Python interpreter"):
        find_blender(str(tmp_path / name))


def test_an_interpreter_without_bpy_takes_the_one_of_the_environment_variable(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    python = fake_blender(tmp_path / "python")
    monkeypatch.setenv(VARIABLE, python)
    assert find_blender() == python
    other = fake_blender(tmp_path / "other")
    assert find_blender(other) == other
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(SimulationError, match="nowhere is not a Python interpreter"):
        find_blender()


def test_an_interpreter_with_bpy_is_used_itself(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    python = fake_blender(tmp_path / "python")
    monkeypatch.setattr(sys, "executable", python)
    assert find_blender() == python


def test_without_any_the_message_names_both_ways_to_give_one(monkeypatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("embodiedreamer_gym.standin.film.blender._probe", lambda python: ("3.13", False))
    with pytest.raises(MissingExtraError, match=r"--blender ENV/bin/python or EMBODIEDREAMER_BLENDER=ENV/bin/python\."):
        find_blender()
    monkeypatch.setattr("embodiedreamer_gym.standin.film.blender._probe", lambda python: ("3.11", False))
    with pytest.raises(MissingExtraError, match=r"run: pip install --no-deps 'bpy>=5.0.1,<6'\."):
        find_blender()


def test_poses_follow_the_scene_through_the_protocol(tmp_path: Path, monkeypatch) -> None:
    """The other interpreter does not get this one's search path for modules."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "modules"))
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "json.py").write_text("raise ImportError('of another interpreter')")
    studio = Studio({"size": [4, 2], "frames": [[0]], "moving": ["cup"]}, fake_blender(tmp_path / "python"))
    first, second = studio.read(), studio.shoot(np.eye(4)[None])
    studio.close()
    studio.close()
    assert first.shape == second.shape == (2, 4, 3)
    np.testing.assert_allclose(second, 1.01 * first, rtol=1e-6)


def test_the_studio_script_imports_only_the_standard_library_and_blender() -> None:
    names = set()
    for node in ast.walk(ast.parse(STUDIO.read_text())):
        names |= {alias.name for alias in node.names} if isinstance(node, ast.Import) else set()
        names |= {str(node.module)} if isinstance(node, ast.ImportFrom) else set()
    assert names and {name.partition(".")[0] for name in names} <= set(sys.stdlib_module_names)
    run = subprocess.run([sys.executable, "-I", str(STUDIO)], input="", capture_output=True, text=True, timeout=60)
    assert run.returncode == 1 and run.stdout == ""
    assert "'bpy'" in run.stderr or "JSONDecodeError" in run.stderr  # without Blender, and with it


def test_nothing_of_the_package_imports_blender() -> None:
    code = "import sys, embodiedreamer_gym.standin.film.run; print('bpy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.stdout.split()[-1] == "False"


def test_pictures_come_as_floats_from_the_bottom_up(tmp_path: Path) -> None:
    frame = np.arange(2 * 4 * 4, dtype=np.float32).reshape(2, 4, 4)
    (tmp_path / "frame").write_bytes(frame.tobytes())
    python = fake_python(
        tmp_path / "python", "3 11 True", f"cat >/dev/null; for i in 1 2 3; do cat {tmp_path}/frame; done"
    )
    found = list(render(SCENE, python))
    assert len(found) == 3
    for one in found:
        np.testing.assert_array_equal(one, frame[::-1, :, :3])


def test_a_failure_is_told_in_its_last_words(tmp_path: Path) -> None:
    python = fake_python(tmp_path / "python", "3 11 True", "echo first >&2; echo 'out of paint' >&2; exit 3")
    with pytest.raises(SimulationError, match=r"Blender has failed: out of paint\."):
        list(render(SCENE, python))


def test_a_renderer_nobody_listens_to_ends(tmp_path: Path) -> None:
    python = fake_python(tmp_path / "python", "3 11 True", f"echo $$ >{tmp_path}/pid; exec cat /dev/zero")
    frames = render(SCENE, python)
    next(frames)
    frames.close()
    assert not Path("/proc", (tmp_path / "pid").read_text().strip()).exists()


# ---- with Blender --------------------------------------------------------------------------------------------------


@needs_bpy
def test_points_are_drawn_where_a_lens_of_any_kind_says() -> None:
    """Axis off the middle, pixels that are not square: to a tenth of a pixel."""
    parts = [Part(f"ball{i}", 10 + i, "cup", *sphere(0.02)) for i in range(len(POINTS))]
    poses = np.tile(np.eye(4), (1, len(POINTS), 1, 1))
    poses[0, :, :3, 3] = POINTS
    scene = make_scene(Animation(parts, tuple(p.body for p in parts), poses), lab(), ASKEW, classes=True)
    drawn = np.rint(next(iter(render(scene)))[..., 0]).astype(int)
    position, rotation = ASKEW.pose()
    for i, point in enumerate(POINTS):
        seen = rotation.T @ (point - position)
        u, v, _ = ASKEW.matrix() @ seen / seen[2]
        rows, columns = np.nonzero(drawn == 10 + i)
        assert len(rows) > 8 and np.hypot(columns.mean() - u, rows.mean() - v) < 0.25


@needs_bpy
@pytest.mark.parametrize("size", [(128, 96), (320, 240)])
def test_outlines_are_the_simulators(stage: EpisodePlayer, size: tuple[int, int]) -> None:
    """Robot and table overlap by 97 and 99 %; things lie within a pixel."""
    camera, taken = resized(CAMERAS["head"], size), []

    def watch(step: int) -> None:
        if step in (5, 60):
            taken.append((step, stage.capture(camera, size).segmentation))

    played = stage.play(5, 61, watch)
    poses = played.poses[[step for step, _ in taken]]
    scene = make_scene(Animation(stage.parts, played.bodies, poses), lab(), camera, classes=True)
    for light, (_, theirs) in zip(render(scene), taken, strict=True):
        ours = np.rint(light[..., 0]).astype(np.uint8)
        assert overlap(ours == 1, theirs == 1) > 0.985 and overlap(ours == 2, theirs == 2) > 0.96
        for number in (3, 4):
            away = np.argwhere(ours == number).mean(axis=0) - np.argwhere(theirs == number).mean(axis=0)
            assert np.hypot(*away) < 1.0
        assert (ours != theirs).mean() < 0.01


@needs_bpy
def test_a_picture_is_lit_still_and_the_same_again(stage: EpisodePlayer, capfd: pytest.CaptureFixture) -> None:
    poses = np.repeat(stage.play(5, 1).poses, 2, axis=0)
    scene = make_scene(
        Animation(stage.parts, (*stage.links, *stage.props), poses), lab(), resized(CAMERAS["head"], (64, 48))
    )
    capfd.readouterr()
    first, second = render(scene)
    np.testing.assert_array_equal(first, second)
    again = next(iter(render(scene)))
    np.testing.assert_array_equal(first, again)
    assert first.shape == (48, 64, 3) and np.isfinite(first).all() and 0.05 < np.median(first) < 2.0
    assert capfd.readouterr() == ("", "")
