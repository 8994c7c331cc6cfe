"""What an HDF5 file claims is checked before anything is read; errors are one sentence with the file's name."""

from __future__ import annotations

import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError, VisionError
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.recordings.episodes import open_episodes
from embodiedreamer_gym.recordings.frames import decode
from embodiedreamer_gym.recordings.hdf5 import new_hdf5, open_hdf5, read_settings
from embodiedreamer_gym.vis_aligner import load_episode

QPOS, HEAD, SIM = "observations/qpos", "observations/images/head", "observations/sim/head"
GIANTS: dict[str, Callable[[h5py.File], object]] = {
    "at most 10000000 numbers": lambda file: file.create_dataset(QPOS, (45_000_000, 14), "f8", chunks=(64, 14)),
    "in chunks of": lambda file: file.create_dataset(QPOS, (10**5, 10**4), "f8", chunks=(10**5, 10**3)),
    "are allowed": lambda file: file.create_dataset(HEAD, (20, 9000, 9000, 3), "u1", chunks=(1, 900, 900, 3)),
}


def log(path: Path, change: Callable[[h5py.File], object] = lambda file: None) -> Path:
    """A small log, whose datasets a function may replace."""
    with h5py.File(path, "w") as file:
        file.attrs["rate"] = 50
        change(file)
        for key in ("action", QPOS):
            if key not in file:
                file[key] = np.sin(np.arange(60.0)).reshape(20, 3)
    return path


@pytest.mark.parametrize("message", GIANTS)
def test_a_small_file_that_claims_gigabytes_is_refused_in_no_memory(tmp_path: Path, message: str) -> None:
    path = log(tmp_path / "a.hdf5", GIANTS[message])
    assert path.stat().st_size < 50_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for read in (load_recordings, open_episodes):
        with pytest.raises(RecordingError, match=message) as caught:
            read(path)
        assert "a.hdf5: " in str(caught.value) and "\n" not in str(caught.value)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


def test_the_datasets_of_a_clip_are_counted_together(tmp_path: Path) -> None:
    """Each of them would fit; compressed zeros take little room in the file."""
    path = tmp_path / "clip.hdf5"
    with h5py.File(path, "w") as file:
        for key in (HEAD, f"{SIM}/rgb", f"{SIM}/classes"):
            shape = (250, 1000, 1000, 3)[: 3 if key.endswith("classes") else 4]
            file.create_dataset(key, shape, "u1", chunks=(1, *shape[1:]), compression="gzip")
    code = f"""
import resource
resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, 6 * 2**30))
from embodiedreamer_gym.vis_aligner import load_episode
try:
    load_episode({str(path)!r})
except ValueError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "at most 1.0 GB of a file are read at once" in done.stdout


def png(width: int, height: int) -> bytes:
    """A header of a PNG of any size, and no pixels."""
    head = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))


def jpeg(width: int, height: int) -> bytes:
    """The first segments of a JPEG of any size."""
    return (
        b"\xff\xd8\xff\xe0\x00\x04ab\xff\xff\xc0\x00\x0b\x08" + struct.pack(">HH", height, width) + b"\x01\x01\x11\x00"
    )


@pytest.mark.parametrize("image", [png, jpeg])
def test_images_with_giant_headers_are_not_decoded(image: Callable[[int, int], bytes]) -> None:
    with pytest.raises(RecordingError, match="frame 3 claims 30000 x 20000 pixels; at most 8192"):
        decode(np.frombuffer(image(30000, 20000), np.uint8), "frame 3")
    with pytest.raises(RecordingError, match="frame 3 is not a JPEG or PNG"):
        decode(np.frombuffer(image(30, 20), np.uint8), "frame 3")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (h5py.SoftLink("/nowhere"), "is missing"),
        (h5py.ExternalLink("other.hdf5", "/x"), "is missing|points to another file|damaged"),
        (np.zeros((20, 3), complex), "numbers of shape"),
        (h5py.Empty("f4"), "is missing"),
        ("text", "numbers of shape"),
    ],
)
def test_other_things_in_a_datasets_place(tmp_path: Path, value: object, message: str) -> None:
    path = log(tmp_path / "a.hdf5", lambda file: file.__setitem__(QPOS, value))
    with pytest.raises(RecordingError, match=message) as caught:
        load_recordings(path)
    assert "a.hdf5: " in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["joint_names", "noise", "rate", "units"])
@pytest.mark.parametrize("value", [10**15, "[" * 5000, "[1" + "0" * 400 + "]", b"\xff", h5py.Empty("f4"), [[1.0, 2.0]]])
def test_attributes_of_other_types(tmp_path: Path, name: str, value: object) -> None:
    path = log(tmp_path / "a.hdf5", lambda file: file.attrs.__setitem__(name, value))
    with pytest.raises(RecordingError) as caught:
        load_recordings(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_errors_take_the_callers_class_and_the_files_name(tmp_path: Path) -> None:
    path = log(tmp_path / "a.hdf5")
    with (
        pytest.raises(VisionError, match=r"a\.hdf5: the dataset /x is missing; the file has /action"),
        open_hdf5(path, VisionError) as file,
    ):
        file.dataset("x")
    with pytest.raises(VisionError, match=r"a\.hdf5: odd"), open_hdf5(path, VisionError):
        raise RecordingError("odd")
    with pytest.raises(VisionError, match="the dataset /observations/images/head is missing"):
        load_episode(path)


def test_a_clip_of_other_types_names_its_file(tmp_path: Path) -> None:
    path = tmp_path / "clip.hdf5"
    with h5py.File(path, "w") as file:
        file[HEAD] = file[f"{SIM}/rgb"] = np.zeros((2, 4, 6, 3), np.uint8)
        file[f"{SIM}/classes"] = np.zeros((2, 4, 6))
    with pytest.raises(VisionError, match=r"clip\.hdf5: classes and parts must be uint8"):
        load_episode(path)


def test_an_interrupted_file_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), new_hdf5(tmp_path / "a.hdf5") as file:
        file["action"] = np.zeros(3)
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_settings_of_another_file_are_in_the_way(tmp_path: Path) -> None:
    path = log(tmp_path / "a.hdf5", lambda file: file.attrs.__setitem__("film", '{"size": 3}'))
    assert read_settings(path, "film", "filmed episode") == {"size": 3}
    for attribute in ("other", "rate"):
        with pytest.raises(RecordingError, match=r"a\.hdf5 exists already and is not a filmed episode"):
            read_settings(path, attribute, "filmed episode")
