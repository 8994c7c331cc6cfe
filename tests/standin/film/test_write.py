"""Files of filmed episodes: the layout, whole or not at all, and never over something else."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.engines.bullet.rendering import Frame
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.recordings.aloha_hdf5 import ALOHA_JOINTS
from embodiedreamer_gym.standin.film.write import CameraFrame, SimulatorFrame, is_filmed, write_episode

SETTINGS = {"task": "PutCupOnMat", "size": [8, 6], "frames": None}
ATTRIBUTES = {
    "film": SETTINGS,
    "rate": 30.0,
    "joint_names": list(ALOHA_JOINTS),
    "class_names": ["table", "cup"],
    "side": "left",
}
COUNT = 12
HULLS = np.random.default_rng(2).uniform(-0.1, 0.1, (4, 5, 3)).astype(np.float32)
PLACES = {
    "observations/images/head": (np.uint8, (6, 8, 3)), "observations/clean/head": (np.uint8, (6, 8, 3)),
    "observations/masks/head": (np.uint8, (6, 8)), "observations/sim/head/rgb": (np.uint8, (6, 8, 3)),
    "observations/sim/head/depth": (np.float16, (6, 8)), "observations/sim/head/classes": (np.uint8, (6, 8)),
}  # fmt: skip


def signals() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    found = {"action": rng.uniform(0, 1, (COUNT, 14)), "observations/qpos": rng.uniform(0, 1, (COUNT, 14))}
    return {**found, "timestamps": np.arange(COUNT) / 30.0, "objects/cup": rng.uniform(0, 1, (COUNT, 7))}


def pictures(count: int = COUNT) -> Iterator[tuple[CameraFrame, SimulatorFrame]]:
    rng = np.random.default_rng(1)
    for _ in range(count):
        colour = [rng.integers(0, 255, (6, 8, 3)).astype(np.uint8) for _ in range(3)]
        classes, masks, parts = (rng.integers(0, 5, (6, 8)).astype(np.uint8) for _ in range(3))
        depth, projections = (rng.uniform(0.3, 2.0, shape).astype(np.float32) for shape in ((6, 8), (4, 3, 4)))
        seen = Frame(colour[2], depth, classes, parts, projections, HULLS)
        yield CameraFrame(*colour[:2]), SimulatorFrame(seen, masks)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "cup_000.hdf5"
    write_episode(path, signals(), {"head": pictures()}, ATTRIBUTES)
    given = list(pictures())
    with h5py.File(path) as file:
        for place, (kind, shape) in PLACES.items():
            assert file[place].dtype == kind and file[place].shape == (COUNT, *shape)
        np.testing.assert_array_equal(file["observations/sim/head/hulls"][:], HULLS)
        for k in range(COUNT):
            real, simulated = given[k]
            np.testing.assert_array_equal(file["observations/images/head"][k], real.noisy)
            np.testing.assert_array_equal(file["observations/clean/head"][k], real.clean)
            np.testing.assert_array_equal(file["observations/masks/head"][k], simulated.masks)
            np.testing.assert_array_equal(file["observations/sim/head/classes"][k], simulated.frame.segmentation)
            np.testing.assert_array_equal(file["observations/sim/head/parts"][k], simulated.frame.parts)
            np.testing.assert_array_equal(file["observations/sim/head/projections"][k], simulated.frame.projections)
            np.testing.assert_allclose(file["observations/sim/head/depth"][k], simulated.frame.depth, atol=1e-3)
        assert json.loads(file.attrs["film"]) == SETTINGS and file.attrs["side"] == "left"
        assert json.loads(file.attrs["class_names"]) == ["table", "cup"]
    log = load_recordings(tmp_path)[0]
    np.testing.assert_array_equal(log.position, signals()["observations/qpos"])
    np.testing.assert_array_equal(log.command, signals()["action"])
    np.testing.assert_array_equal(log.frames["head"][4], given[4][0].noisy)
    assert log.hz == pytest.approx(30.0) and [p.name for p in tmp_path.iterdir()] == ["cup_000.hdf5"]


def test_the_same_episode_is_the_same_file(tmp_path: Path) -> None:
    for name in ("a.hdf5", "b.hdf5"):
        write_episode(tmp_path / name, signals(), {"head": pictures()}, ATTRIBUTES)
    assert (tmp_path / "a.hdf5").read_bytes() == (tmp_path / "b.hdf5").read_bytes()


def test_an_interrupted_episode_leaves_nothing(tmp_path: Path) -> None:
    def cut() -> Iterator[tuple[CameraFrame, SimulatorFrame]]:
        yield from pictures(4)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_episode(tmp_path / "cup_000.hdf5", signals(), {"head": cut()}, ATTRIBUTES)
    assert not list(tmp_path.iterdir())


def test_a_place_that_takes_no_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"missing/cup\.hdf5 cannot be written"):
        write_episode(tmp_path / "missing" / "cup.hdf5", signals(), {"head": pictures()}, ATTRIBUTES)


def test_what_is_there_is_the_same_or_in_the_way(tmp_path: Path) -> None:
    path = tmp_path / "cup_000.hdf5"
    assert not is_filmed(path, SETTINGS)
    write_episode(path, signals(), {"head": pictures()}, ATTRIBUTES)
    assert is_filmed(path, SETTINGS)
    with pytest.raises(RecordingError, match=r"filmed with size \[8, 6\], not \[16, 12\]; give another folder"):
        is_filmed(path, {**SETTINGS, "size": [16, 12]})
    with pytest.raises(RecordingError, match="filmed with samples null, not 4"):
        is_filmed(path, {**SETTINGS, "samples": 4})
    for name, data in (("text.hdf5", b"no HDF5"), ("half.hdf5", path.read_bytes()[:3000])):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(RecordingError, match=f"{name} exists already and is not a filmed episode"):
            is_filmed(tmp_path / name, SETTINGS)
    with h5py.File(tmp_path / "log.hdf5", "w") as file:
        file["action"] = np.zeros((3, 14))
    with pytest.raises(RecordingError, match="exists already"):
        is_filmed(tmp_path / "log.hdf5", SETTINGS)
    with pytest.raises(RecordingError, match="exists already"):
        is_filmed(tmp_path, SETTINGS)
