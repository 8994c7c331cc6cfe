"""The verb `augment`: what it parses, calls and prints."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.cli.command import execute
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.pipelines import regenerate as module
from embodiedreamer_gym.pipelines.regenerate import Regenerated
from embodiedreamer_gym.vis_aligner.editing import Background, Chain, Inpaint, PaperSheet, Recolour


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[dict[str, Any]]]:
    """Runs the verb with a stand-in for the work; what that was asked."""
    calls: list[dict[str, Any]] = []

    def regenerate(data, out, aligner, bank, editor, copies, seed, tell, **more: Any) -> Regenerated:
        tell("replaying episodes", 1, 2, failed=0)
        calls.append({"data": data, "out": out, "aligner": aligner, "bank": bank, "editor": editor, "copies": copies,
                      "seed": seed, **more})  # fmt: skip
        return Regenerated(3, 1, ("episode_7",) if copies > 1 else ())

    monkeypatch.setattr(module, "regenerate", regenerate)

    def call(*words: str) -> list[dict[str, Any]]:
        execute(["augment", "--data", "real", "--out", "made", *words])
        return calls

    return call


def test_without_edits_it_only_dreams(run, capsys: pytest.CaptureFixture[str]) -> None:
    assert run() == [{
        "data": ["real"], "out": Path("made"), "aligner": "lean", "bank": "lab", "editor": None, "copies": 1, "seed": 0,
        "prompt": None, "task": None, "robot": None, "jobs": 1, "cameras": ("head",),
    }]  # fmt: skip
    shown = capsys.readouterr()
    assert shown.out == "4 episodes in made, 1 of them from an earlier run\n"
    assert "replaying episodes: 1 of 2 (50 %), failed 0" in shown.err
    run("--quiet")
    assert capsys.readouterr().err == ""


def test_what_is_asked_for(run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 4, 3), np.uint8))
    found = run(
        "--edit", "recolour:cup,mat", f"background:{tmp_path}", "table", "paper", "inpaint:model", "--prompt", "marble",
        "--copies", "3", "--bank", "none", "--task", "EmbodieDreamer/PutCupOnMat-v0", "--seed", "4", "--jobs", "2",
    )[0]  # fmt: skip
    assert found["editor"] == Chain([
        Recolour(("cup", "mat")), Background(pictures=str(tmp_path)), Background(("table",)),
        PaperSheet(CAMERAS["head"]), Inpaint("model"),
    ])  # fmt: skip
    assert (found["bank"], found["task"], found["prompt"], found["copies"]) == (None, "PutCupOnMat", "marble", 3)
    assert "1 recorded episodes no longer end in success and were left out: episode_7\n" in capsys.readouterr().out


def test_one_edit_is_no_chain(run) -> None:
    assert run("--edit", "recolour")[0]["editor"] == Recolour()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--copies", "0"], "--copies: 0 is not a whole number from 1 to"),
        (["--seed", "-1"], "--seed: -1 is not a whole number from 0 to"),
        (["--edit", "paint"], "--edit paint is none of recolour"),
        (["--edit", "inpaint"], "--edit inpaint is none of"),
        (["--edit", "paper:big"], "--edit paper:big is none of"),
        (["--edit", "recolour", "--prompt", "red"], "--prompt is for --edit inpaint"),
        (["--edit", "background:/nowhere"], "holds no pictures"),
    ],
)
def test_mistakes_are_one_sentence(run, words: list[str], said: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=said):
        run(*words)
