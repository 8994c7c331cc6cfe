"""The verb `demos`: what it parses, calls and prints."""

from __future__ import annotations

from pathlib import Path

import pytest

from embodiedreamer_gym.cli.command import execute
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.pipelines import demonstrations
from embodiedreamer_gym.recordings.episodes import open_episodes


def run(*words: str) -> None:
    execute(["demos", *words])


def test_an_episode_on_disk(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("--task", "GrabPaperCup-v0", "--episodes", "1", "--out", str(tmp_path / "demos"), "--size", "16x12",
        "--cameras", "head,left_wrist", "--jobs", "1")  # fmt: skip
    episodes = open_episodes(tmp_path / "demos")
    assert episodes.cameras == ("head", "left_wrist") and episodes.frame_size("head") == (16, 12)
    said = capsys.readouterr()
    assert said.out == f"1 episodes in {tmp_path / 'demos'}; 0 attempts failed and were left out\n"
    assert "episodes: 1 of 1 (100 %), failed attempts 0" in said.err


def test_what_is_asked_for_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    calls = []
    for name in ("record_demonstrations", "record_lerobot"):
        monkeypatch.setattr(demonstrations, name, lambda *a, name=name: (calls.append((name, *a[:4])), 2)[1])
    rest = ("--episodes", "3", "--seed", "5", "--jobs", "2", "--quiet", "--out", str(tmp_path))
    run("--task", "EmbodieDreamer/PutPenInCup-v0", *rest)
    run("--task", "PutPenInCup", "--format", "lerobot", "--size", "64x48", *rest)
    wanted = demonstrations.Demonstrations("PutPenInCup", 5)
    assert calls[0] == ("record_demonstrations", wanted, 3, tmp_path, 2)
    assert calls[1][0] == "record_lerobot" and calls[1][1].size == (64, 48)
    assert calls[1][1].retarget is None
    said = capsys.readouterr()
    assert "2 attempts failed" in said.out and said.err == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--episodes", "0"), "--episodes: 0 is not a whole number from 1 to"),
        (("--jobs", "0"), "--jobs: 0 is not"),
        (("--size", "big"), "--size big is not a width and a height"),
        (("--cameras", "foot"), "camera 'foot' is not one of"),
        (("--task", "Fly-v0"), "there is no task 'Fly'"),
        (("--retarget", "/no/such/folder"), "there is no HDF5 episode"),
    ],
)
def test_what_cannot_be(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=message):
        run("--task", "PutCupOnMat-v0", "--out", str(tmp_path / "demos"), *words)
    assert not (tmp_path / "demos").exists()
