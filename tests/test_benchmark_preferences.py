"""The twin of PutCupOnMat, and the study on it: what it plays, prints, keeps and does not run again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import preferences as study
from benchmarks.preference_twin import STEPS, Twin, demonstrate, forward, inverse, scene
from embodiedreamer_gym.policies.preferences import CloningConfig


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Little training and few starts."""
    monkeypatch.setattr(study, "SFT", CloningConfig(epochs=3, batch=64, learning_rate=1e-3))
    monkeypatch.setattr(study, "STARTS", 5)
    monkeypatch.setattr(study, "DEMOS", 3)
    monkeypatch.setattr(study, "TRIES", 3)
    monkeypatch.setattr(study, "EPOCHS", 2)
    study._supervised.cache_clear()


def test_the_arm_reaches_where_it_is_told() -> None:
    places = np.random.default_rng(0).uniform([0.2, -0.1, 0.02], [0.36, 0.1, 0.15], (50, 3))
    assert np.abs(forward(inverse(places)) - places).max() < 1e-9


def test_the_expert_succeeds_and_standing_still_does_not() -> None:
    demos = demonstrate(list(range(40)))
    assert all(one.success and one.outcome["distance"] < 0.01 for one in demos)
    env = Twin(20)
    env.reset(seed=list(range(20)))
    still = np.broadcast_to(np.append(env.q[0], 1.0), (20, 10, 4))
    for chunk in range(STEPS // 10):
        *_, over, info = env.step(still)
        assert over.all() == (chunk == 5)
    assert not info["is_success"].any() and not info["grasp_success"].any()


def test_a_cup_is_held_only_by_a_closed_gripper_that_is_near() -> None:
    env = Twin(3)
    env.reset(seed=[1, 2, 3])
    env.q = inverse(np.array([[0, 0, 0.04], [0, 0, 0.04], [0.03, 0, 0.04]]) + env.cup)
    env.move(np.column_stack([env.q, [0.0, 1.0, 0.0]]))
    env.move(np.column_stack([env.q, [0.0, 1.0, 0.0]]))
    assert env.held.tolist() == [True, False, False]
    env.move(np.column_stack([inverse(np.array([0, 0, 0.2]) + env.mat), [0.0, 1.0, 0.0]]))
    assert env.cup[0, 2] > 0.005 and (env.cup[1:, 2] == 0).all(), "what is held goes along"
    for _ in range(2):
        env.move(np.column_stack([env.q, np.ones(3)]))
    assert not env.held.any() and env.cup[0, 2] == 0


def test_scenes_are_of_their_seeds_and_apart() -> None:
    assert np.array_equal(scene(7), scene(7)) and not np.array_equal(scene(7), scene(8))
    assert min(np.linalg.norm(a - b) for a, b in map(scene, range(200))) > 0.08
    used = [set(study.starts(seed, cycle, 100)) for seed in (0, 1, 100) for cycle in range(5)]
    assert len(set.union(*used)) == 15 * 100, "no start is met twice"


def test_the_study_prints_keeps_and_goes_on(quick, tmp_path: Path, capsys, monkeypatch) -> None:
    names = ["sft", "sft continued", "filtered bc", "clipped+dpop", "paper", "rwr", "filtered bc, top 25"]
    by_tip = study.prefer("clipped+dpop", metric="distance")  # which so little training moves no cup for
    monkeypatch.setitem(study.METHODS, "clipped+dpop", by_tip)
    words = ["--seeds", "7", "8", "--cycles", "1", "--evaluations", "20", "--out", str(tmp_path), "--methods", *names]
    study.main([*words, "--plot", str(tmp_path / "curve.png")])
    printed = capsys.readouterr().out
    lines = printed[printed.index("success, %") :].splitlines()
    assert [line[:24].strip() for line in lines[1:8]] == names and "±" in lines[2]
    assert (tmp_path / "curve.png").read_bytes()[:4] == b"\x89PNG"
    assert len(list(tmp_path.glob("*.json"))) == 14

    monkeypatch.setattr(study, "study", None)
    study.main([*words[:-7], "paper"])
    again = capsys.readouterr().out.splitlines()[1]
    assert again.split()[:3] == next(line for line in lines if line.startswith("paper")).split()[:3]


def test_ppo_starts_from_the_supervised_policy(quick, tmp_path: Path) -> None:
    from benchmarks.preference_ppo import learn

    network, _ = study.first_policy(7)
    before = network.head.weight.detach().clone()
    rows = learn(7, network, 1, lambda cycle: study.starts(7, cycle, 5), 2, 0.1, "distance",
                 lambda one: study.judge(one, 7, 10), 1e-3)["rows"]  # fmt: skip
    assert len(rows) == 2 and rows[1]["remark"] == "60 chunks"
    changed = (network.head.weight != before).any(1)
    assert changed[:40].any() and not changed[40:].any(), "of a chunk, what is played"
