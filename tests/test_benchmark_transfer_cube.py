"""The benchmark on gym-aloha's task: training, evaluation and its table, with a small environment in place of gym-aloha's."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from benchmarks import transfer_cube
from embodiedreamer_gym.recordings.episodes import write_aloha_episode


class Cube(gym.Env):
    """Every third episode succeeds in its second chunk."""

    def __init__(self, size: tuple[int, int], chunk: int) -> None:
        self.size, self.chunk, self.count, self.number = size, chunk, 0, 0
        self.action_space = gym.spaces.Box(-np.inf, np.inf, (chunk, 14), np.float32)

    def observation(self) -> dict[str, Any]:
        return {"pixels": {"top": np.zeros((*self.size[::-1], 3), np.uint8)}, "agent_pos": np.zeros(14)}

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        self.number, self.count = int(seed or 0), 0
        return self.observation(), {}

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert action.shape == (self.chunk, 14)
        self.count += 1
        done = self.number % 3 == 0 and self.count == 2
        info = {"is_success": done, "successes": np.array([done]), "steps": 1, "grasp_success": self.count == 2}
        return self.observation(), 0.0, done, self.count == 4, info


def test_policies_are_trained_and_evaluated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(transfer_cube, "SIZE", (32, 24))
    monkeypatch.setitem(sys.modules, "benchmarks.transfer_cube_env", SimpleNamespace(TransferCube=Cube))  # pyright: ignore
    (tmp_path / "demonstrations").mkdir()
    rng = np.random.default_rng(0)
    for seed in range(2):
        states, pictures = rng.standard_normal((30, 14)), rng.integers(0, 255, (30, 24, 32, 3), np.uint8)
        path = tmp_path / "demonstrations" / f"seed_{seed}.hdf5"
        write_aloha_episode(path, states, states, {"top": list(pictures)}, hz=50.0)
    command = ["--out", str(tmp_path), "--stage", "train", "evaluate", "--steps", "2", "--episodes", "6",
               "--json", str(tmp_path / "rows.json")]  # fmt: skip
    transfer_cube.main(command)
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert (row["hits"], row["of"], row["steps"]) == (2, 6, 2) and row["low"] < 1 / 3 < row["high"]
    assert row["training_cpu_s"] > 0
    assert "training seed 0: 2 of 6" in capsys.readouterr().out
    monkeypatch.setattr(Cube, "step", None)  # nothing is trained or played again
    transfer_cube.main(command)
    assert json.loads((tmp_path / "rows.json").read_text()) == [row]


def test_what_is_missing_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        transfer_cube.main(["--out", str(tmp_path), "--stage", "train"])
    assert stop.value.code == 2 and "demonstrations: there is no such file or folder" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "benchmarks.transfer_cube_env", None)  # pyright: ignore
    with pytest.raises(SystemExit):
        transfer_cube.main(["--out", str(tmp_path), "--stage", "evaluate"])
    assert "need gym-aloha, in an environment of its own" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
