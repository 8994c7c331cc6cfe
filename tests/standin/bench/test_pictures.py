"""The camera before the bench: one Blender, one exposure, the films' lens and noise."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.standin.bench import pictures
from embodiedreamer_gym.standin.bench.pictures import PathTraced
from embodiedreamer_gym.standin.bench.robot import load_nominal
from embodiedreamer_gym.standin.film.blender import Studio
from tests.standin.film.grey import fake_python

SIZE = (64, 48)
CUP = TASKS["GrabPaperCup"]().props


class Dark:
    """A studio whose light is even, and half as bright in all but the first frame."""

    made: list[Dark] = []

    def __init__(self, scene: Mapping[str, Any], blender: str) -> None:
        self.scene, self.shot, self.closed = scene, [], False
        self.made.append(self)

    def read(self, share: float = 1.0) -> np.ndarray:
        width, height = self.scene["size"]
        return np.full((height, width, 3), 0.3 * share, np.float32)

    def shoot(self, poses: np.ndarray) -> np.ndarray:
        self.shot.append(poses)
        return self.read(0.5)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> PathTraced:
    """The camera with a studio that takes no time."""
    Dark.made.clear()
    monkeypatch.setattr(pictures, "Studio", Dark)
    monkeypatch.setattr(pictures, "find_blender", lambda blender: "python")
    return PathTraced(load_nominal(), CUP, "lab", SIZE)


def places(camera: PathTraced, height: float = 1.0) -> dict[str, np.ndarray]:
    """Every body at a height."""
    pose = np.eye(4)
    pose[2, 3] = height
    return {"table": pose, **dict.fromkeys(camera.bodies, pose)}


def test_one_studio_is_exposed_by_the_robot_alone(camera: PathTraced) -> None:
    rng = np.random.default_rng(0)
    first, second = camera.take(places(camera), rng), camera.take(places(camera, 0.9), rng)
    (studio,) = Dark.made
    assert studio.scene["moving"] == list(camera.bodies) and studio.scene["samples"] == 4
    empty = dict(zip(studio.scene["moving"], np.array(studio.scene["frames"])[0, :, 2, 3].tolist(), strict=True))
    assert empty["cup"] == 1.0 - 50.0 and empty["left_link6"] == 1.0
    assert [shot[:, 2, 3].tolist() for shot in studio.shot] == [[h] * len(camera.bodies) for h in (1.0, 0.9)]
    assert first.shape == (48, 64, 3) and first.dtype == np.uint8
    assert 60 < np.median(first) < 110  # the even grey of the key, 132, at half its light
    assert 1.0 < np.abs(first.astype(int) - second).mean() < 4.0


def test_noise_is_the_generators(camera: PathTraced) -> None:
    one, two, other = (camera.take(places(camera), np.random.default_rng(seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, two)
    assert (one != other).any()


def test_a_closed_camera_starts_again(camera: PathTraced) -> None:
    camera.close()
    camera.take(places(camera), np.random.default_rng(0))
    camera.close()
    camera.close()
    camera.take(places(camera), np.random.default_rng(0))
    assert [studio.closed for studio in Dark.made] == [True, False]


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize(
    ("appearance", "size", "sentence"),
    [
        ("many", SIZE, "a bench has one appearance; give lab, or a whole number"),
        ("attic", SIZE, "there is no appearance 'attic'"),
        ("lab", (64, 4096), "pictures cannot be 64 x 4096 pixels; each may be 16 to 2048"),
    ],
)
def test_what_it_cannot_show_is_named(appearance: str, size: tuple[int, int], sentence: str) -> None:
    with pytest.raises(VisionError, match=sentence):
        PathTraced(load_nominal(), CUP, appearance, size)


def test_frames_may_follow_a_scene(tmp_path: Path) -> None:
    """One process hears a scene, then poses a line at a time, and answers each."""
    for number in range(3):
        (tmp_path / f"{number}").write_bytes(np.full((2, 4, 4), number, np.float32).tobytes())
    talk = 'read scene; cat 0; n=1; while read poses; do echo "$poses" >>heard; cat $n; n=$((n+1)); done'
    studio = Studio({"size": [4, 2]}, fake_python(tmp_path / "python", "3 11 True", f"cd {tmp_path}; {talk}"))
    try:
        assert (studio.read() == 0).all()
        poses = np.arange(32.0).reshape(2, 4, 4)
        for number in (1, 2):
            light = studio.shoot(poses + number)
            assert light.shape == (2, 4, 3) and (light == number).all()
        heard = [json.loads(line) for line in (tmp_path / "heard").read_text().splitlines()]
        np.testing.assert_array_equal(heard, [poses + 1, poses + 2])
        studio.finish()
        with pytest.raises(SimulationError, match="Blender has failed: it printed nothing"):
            studio.read()
    finally:
        studio.close()
        studio.close()
