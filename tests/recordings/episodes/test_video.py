"""Every frame of a video is the right one, however it is asked for."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError

pytest.importorskip("av", reason="videos need av: pip install 'embodiedreamer-gym[data]'")
pytest.importorskip("pyarrow", reason="LeRobot sets need pyarrow: pip install 'embodiedreamer-gym[data]'")
video = pytest.importorskip("embodiedreamer_gym.recordings.episodes.video")

COUNT, RATE = 40, 30


@pytest.fixture(scope="module", params=list(video.CODECS))
def film(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """40 frames, each 6 levels brighter than the one before."""
    path = tmp_path_factory.mktemp("film") / "a.mp4"
    writer = video.VideoWriter(path, RATE, (64, 48), request.param)
    for number in range(COUNT):
        writer.add(np.full((48, 64, 3), 10 + 6 * number, np.uint8))
    writer.close()
    return path


def read(reader, path: Path, first: int, count: int = 1) -> list[int]:
    """Numbers of the frames that are found at these places."""
    frames = reader.read(path, (first + np.arange(count)) / RATE, RATE, (64, 48))
    assert frames.shape == (count, 48, 64, 3) and frames.dtype == np.uint8
    assert frames.reshape(count, -1).std(1).max() < 2
    return np.round((frames.mean((1, 2, 3)) - 10) / 6).astype(int).tolist()


def test_each_frame_alone_in_any_order(film: Path) -> None:
    reader = video.VideoReader()
    for number in np.random.default_rng(0).permutation(COUNT).tolist():
        assert read(reader, film, number) == [number]
    for number in range(COUNT):  # and by a reader that knows nothing yet
        assert read(video.VideoReader(), film, number) == [number]


def test_windows_forwards_and_back(film: Path) -> None:
    reader = video.VideoReader()
    for start in (0, 10, 20, 30, 25, 3, 2, 1, 0):
        assert read(reader, film, start, 10) == list(range(start, start + 10))
    assert read(reader, film, 0, COUNT) == list(range(COUNT))


def test_the_next_window_is_not_sought(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sought = []
    seek = video._Decoder._seek
    monkeypatch.setattr(video._Decoder, "_seek", lambda self, *a: (sought.append(a), seek(self, *a)))
    reader = video.VideoReader()
    for start in range(0, COUNT, 8):
        assert read(reader, film, start, 8) == list(range(start, start + 8))
    assert len(sought) == 1


def test_few_videos_stay_open(film: Path, tmp_path: Path) -> None:
    reader = video.VideoReader()
    for number in range(video.OPEN + 2):
        path = tmp_path / f"{number}.mp4"
        path.write_bytes(film.read_bytes())
        assert read(reader, path, number) == [number]
    assert len(reader._open) == video.OPEN
    assert read(reader, tmp_path / "0.mp4", 7) == [7]


def test_another_process_opens_its_own(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = video.VideoReader()
    read(reader, film, 0)
    decoder = reader._open[film]
    monkeypatch.setattr(os, "getpid", lambda: -1)
    assert read(reader, film, 1) == [1] and reader._open[film] is not decoder


@pytest.mark.parametrize(
    ("first", "rate", "message"),
    [(COUNT, RATE, "it ends before 1.333 s; frames are missing"), (1.5, RATE, "there is no frame at 0.050 s")],
)
def test_frames_that_are_missing(film: Path, first: float, rate: float, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        video.VideoReader().read(film, np.array([first / rate]), rate, (64, 48))


def test_what_is_no_such_video(film: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(film.read_bytes()[:200])
    list_of_files = tmp_path / "list.mp4"
    list_of_files.write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n{film}\n#EXT-X-ENDLIST\n")
    for path in (cut, list_of_files, tmp_path / "nothing.mp4"):
        with pytest.raises(RecordingError, match="damaged, cut short or not a video"):
            read(video.VideoReader(), path, 0)
    unknown = tmp_path / "unknown.mp4"
    unknown.write_bytes(film.read_bytes().replace(b"avc1", b"none").replace(b"av01", b"none"))
    with pytest.raises(RecordingError, match="its video has no codec that can be read"):
        read(video.VideoReader(), unknown, 0)
    with pytest.raises(RecordingError, match=r"the frames are 64 x 48, not 32 x 48 as meta/info\.json states"):
        video.VideoReader().read(film, np.array([0.0]), RATE, (32, 48))


def test_what_cannot_be_encoded() -> None:
    with pytest.raises(RecordingError, match="codec 'x' is not one of libx264, libsvtav1"):
        video.check_video((64, 48), "x")
    with pytest.raises(RecordingError, match="63 x 48 cannot be a video: width and height must be even"):
        video.check_video((63, 48))
