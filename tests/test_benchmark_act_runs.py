"""Episodes of a benchmark, kept as they come."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.act_runs import keep_settings, play_each, train_act
from embodiedreamer_gym.recordings.episodes import open_episodes, write_aloha_episode


def test_an_interrupted_run_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    played: list[int] = []

    def play(number: int) -> dict[str, bool | int]:
        played.append(number)
        if len(played) == 8:
            raise KeyboardInterrupt
        return {"seed": number, "success": number % 2 == 0}

    path = tmp_path / "rows.json"
    with pytest.raises(KeyboardInterrupt):
        play_each(path, 12, play, "policy")
    assert len(json.loads(path.read_text())) == 5
    rows = play_each(path, 12, play, "policy")
    assert [row["seed"] for row in rows] == list(range(12)) and played[8:] == list(range(5, 12))
    assert capsys.readouterr().out.splitlines()[-1] == "policy: 6/12"
    assert play_each(path, 3, play, "policy") == rows[:3]


def test_results_of_other_settings_are_left_alone(tmp_path: Path) -> None:
    keep_settings(tmp_path / "study", demos=50, steps=None)
    keep_settings(tmp_path / "study", demos=50, steps=None)
    with pytest.raises(SystemExit, match="made with demos 50, not 15; give another folder"):
        keep_settings(tmp_path / "study", demos=15, steps=None)
    assert json.loads((tmp_path / "study" / "settings.json").read_text()) == {"demos": 50, "steps": None}
    (tmp_path / "study" / "settings.json").write_text("{")
    with pytest.raises(SystemExit, match="contains no settings"):
        keep_settings(tmp_path / "study", demos=50, steps=None)


def test_a_training_reports_its_steps(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    states, pictures = rng.standard_normal((30, 14)), rng.integers(0, 255, (30, 24, 32, 3), np.uint8)
    (tmp_path / "demos").mkdir()
    write_aloha_episode(tmp_path / "demos" / "episode_0.hdf5", states, states, {"head": list(pictures)}, hz=30.0)
    shown: list[tuple[int, int, str]] = []
    policy = train_act(open_episodes(tmp_path / "demos"), tmp_path / "policy", {"steps": 2, "batch": 2},
                       lambda *row: shown.append(row), (32, 24), mirror=False)  # fmt: skip
    assert [row[:2] for row in shown] == [(1, 2), (2, 2)] and shown[0][2].startswith("loss ")
    assert policy.chunk == 100 and (tmp_path / "policy" / "weights.pt").is_file()
