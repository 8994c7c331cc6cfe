"""Two policies on the same seeds: when the comparison stops, and what it says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.pipelines import policy_comparison
from embodiedreamer_gym.pipelines.policy_comparison import BLOCK, compare_policies, evidence
from embodiedreamer_gym.pipelines.settings import EvaluationSettings
from embodiedreamer_gym.policies.evaluation import EpisodeResult, Evaluation

SHARES = {"good": 0.9, "bad": 0.2, "same": 0.9}


def played(run: EvaluationSettings, progress: Any = None) -> Evaluation:
    """Episodes whose success depends on policy and seed alone."""
    rows = tuple(
        EpisodeResult(seed, bool(np.random.default_rng(seed).random() < SHARES[run.policy]), None, False, 300, 0.0, "left")
        for seed in range(run.seed, run.seed + run.episodes)
    )  # fmt: skip
    return Evaluation(run.task, 1, rows)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_comparison, "play", played)


def test_it_stops_at_a_block_where_one_is_better() -> None:
    found = compare_policies(EvaluationSettings("good", "T", episodes=95), "bad")
    count = len(found.policy.episodes)
    assert found.decided and count < 95 and count % BLOCK == 0 and "is better" in str(found)
    assert [row.seed for row in found.against.episodes] == list(range(100_000, 100_000 + count))
    assert "is worse" in str(compare_policies(EvaluationSettings("bad", "T", episodes=95), "good"))


def test_equal_policies_are_played_to_the_end() -> None:
    found = compare_policies(EvaluationSettings("good", "T", episodes=25), "same")
    assert len(found.policy.episodes) == 25 and found.pairs == (0, 0) and "no difference" in str(found)


def test_equal_policies_are_seldom_told_apart_however_often_it_is_asked() -> None:
    wins = np.random.default_rng(0).random((2000, 200)) < 0.5
    better = wins.cumsum(1)[:, 9::10]
    counts = np.arange(10, 201, 10)
    asked = np.array(
        [[evidence(int(b), int(n - b)) >= 20.0 for b, n in zip(row, counts, strict=True)] for row in better]
    )
    assert asked.any(1).mean() < 0.05
    assert evidence(9, 0) > 20.0 > evidence(6, 3)


def test_the_verb_writes_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "compared.json"
    arguments = ["--policy", "good", "--against", "bad", "--task", "PutCupOnMat-v0", "--episodes", "30", "--json", str(out), "--quiet"]  # fmt: skip
    assert main(["policy", "evaluate", *arguments]) == 0
    assert "only one succeeded on" in capsys.readouterr().out
    said = json.loads(out.read_text())
    assert said["decided"] and said["only_policy"] > said["only_against"] and said["origin"]["against"] == "bad"
