"""Files are written whole or not at all, and bad JSON is one sentence."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

import pytest

from embodiedreamer_gym.errors import EmbodieDreamerError, ModelError, VisionError
from embodiedreamer_gym.io.files import (
    MAX_DEPTH,
    atomic_file,
    atomic_folder,
    check_outputs,
    read_json,
    write_json,
)


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_a_file_is_there_when_the_block_has_ended(tmp_path: Path) -> None:
    with atomic_file(tmp_path / "a.txt") as part:
        part.write_text("one")
        assert not (tmp_path / "a.txt").exists() and part.parent == tmp_path
    assert (tmp_path / "a.txt").read_text() == "one" and names(tmp_path) == {"a.txt"}
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~mask


@pytest.mark.parametrize("kind", [KeyboardInterrupt, RuntimeError, OSError])
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, kind: type[BaseException]) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(VisionError if kind is OSError else kind), atomic_file(tmp_path / "a.txt", VisionError) as part:
        part.write_text("new")
        raise kind("disk full")
    assert (tmp_path / "a.txt").read_text() == "old" and names(tmp_path) == {"a.txt"}


def test_a_link_stays_and_a_device_is_refused(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real" / "a.txt")
    with atomic_file(tmp_path / "link") as part:
        part.write_text("one")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real" / "a.txt").read_text() == "one"
    with pytest.raises(EmbodieDreamerError, match="regular"):
        write_json({}, "/dev/null")
    assert not Path("/dev/null").is_file()


def test_long_names(tmp_path: Path) -> None:
    write_json({}, tmp_path / ("x" * 255))
    with pytest.raises(EmbodieDreamerError, match="too long"):
        write_json({}, tmp_path / ("x" * 256))


def test_a_suffix_for_writers_that_read_it(tmp_path: Path) -> None:
    with atomic_file(tmp_path / "a.mp4", suffix=".mp4") as part:
        assert part.suffix == ".mp4" and part.name.startswith(".a.mp4.")
        part.touch()


def test_a_folder_is_there_when_the_block_has_ended(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "set"
    with pytest.raises(RuntimeError), atomic_folder(target) as part:
        (part / "a").touch()
        raise RuntimeError
    assert names(tmp_path) == {"deep"}
    with atomic_folder(target) as part:
        (part / "a").touch()
    assert names(target) == {"a"}
    with pytest.raises(ModelError, match="not empty"), atomic_folder(target, ModelError):
        pass
    target.joinpath("a").unlink()
    with atomic_folder(target) as part:  # an empty folder may be there
        (part / "b").touch()
    assert names(tmp_path) == {"deep", "deep/set", "deep/set/b"}


@pytest.mark.parametrize(
    ("name", "folder", "words"),
    [
        ("no/a.json", False, "does not exist"),
        ("file/a.json", False, "is a file"),
        ("folder", False, "a folder"),
        ("file", True, "is a file"),
        ("file/deep/er", True, "is a file"),
        ("x" * 300, False, "cannot be written"),
        ("x" * 300, True, "cannot be written"),
    ],
)
def test_outputs_that_cannot_be(tmp_path: Path, name: str, folder: bool, words: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    before = names(tmp_path)
    with pytest.raises(EmbodieDreamerError, match=words):
        check_outputs(*([] if folder else [tmp_path / name]), folders=[tmp_path / name] if folder else [])
    assert names(tmp_path) == before


def test_outputs_in_a_place_without_permission() -> None:
    with pytest.raises(EmbodieDreamerError, match="cannot be written"):
        check_outputs(Path("/proc/a.json"))


def test_outputs_that_can_be_leave_no_trace(tmp_path: Path) -> None:
    check_outputs(tmp_path / "a.json", None, folders=[tmp_path / "b" / "c", None, tmp_path])
    assert names(tmp_path) == set()


def test_json_survives_the_round(tmp_path: Path) -> None:
    data = {"a": [1, 2.5, None, True], "text": "größer"}
    write_json(data, tmp_path / "a.json")
    assert read_json(tmp_path / "a.json") == data
    with pytest.raises(ValueError, match="Out of range"):
        write_json({"a": float("nan")}, tmp_path / "b.json")
    assert names(tmp_path) == {"a.json"}
    with pytest.raises(VisionError, match="cannot be written"):
        write_json(data, tmp_path / "no" / "a.json", VisionError)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"{", "not readable JSON"),
        (b"\xff\xfe\x00", "UTF-8"),
        (b'["\\ud800"]', "UTF-8"),
        (b"[" * 100_000, "nested"),
        (b"[" * (MAX_DEPTH + 2) + b"]" * (MAX_DEPTH + 2), "nested"),
        (None, "No such file"),
    ],
)
def test_bad_json_is_one_sentence(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "a.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ModelError, match=words) as caught:
        read_json(path, ModelError, "model")
    assert str(caught.value).startswith(f"model {path}") and "\n" not in str(caught.value)


def test_json_has_a_size(tmp_path: Path) -> None:
    with (tmp_path / "a.json").open("wb") as file:
        file.truncate(10**9)
    with pytest.raises(EmbodieDreamerError, match="larger"):
        read_json(tmp_path / "a.json")
    (tmp_path / "a.json").write_text("1" + "0" * 400)
    assert read_json(tmp_path / "a.json") == float("inf")
    (tmp_path / "a.json").write_text(json.dumps(2**128 - 1))
    assert read_json(tmp_path / "a.json") == 2**128 - 1


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    with pytest.raises(EmbodieDreamerError, match="is not a regular file"):
        read_json(pipe)
