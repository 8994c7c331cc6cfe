from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.diagnosis import compare_sessions
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.recordings import save_recording
from tests.two_joint_arm import load_arm, record

NOISE = 5e-4


def test_what_differs_between_two_days_is_named_with_its_size(tmp_path) -> None:
    arm = load_arm(tmp_path)
    later = arm.with_values({"stiffness": {"elbow": 28.0}})
    sessions = {
        "monday": [record(arm, "a", NOISE, seed=1)],
        "tuesday": [record(arm, "b", NOISE, seed=2)],
        "friday": [record(later, "c", NOISE, seed=3)],
    }
    compared = compare_sessions(arm, sessions)
    assert [(d.session, d.parameter) for d in compared.differences if d.differs] == [("friday", "stiffness[elbow]")]
    (change,) = [d for d in compared.differences if d.differs]
    assert change.low is not None and change.high is not None
    assert change.value - change.first == pytest.approx(3.0, abs=0.2)
    assert change.low < change.value - change.first < change.high < change.low + 0.5
    text = str(compared)
    assert "friday differs from monday in 1 of" in text and "tuesday differs from monday in 0 of" in text


def test_a_load_that_the_first_session_lacks(tmp_path, monkeypatch, capsys) -> None:
    """Its mass is on a bound there and has no interval of its own."""
    monkeypatch.chdir(tmp_path)
    arm = load_arm(tmp_path)
    loaded = arm.with_effect("payload").with_values({"payload.mass": {"tip": 0.3}})
    for name, model in (("empty", arm), ("loaded", loaded)):
        for seed in (1, 2):
            save_recording(record(model, f"{name}{seed}", NOISE, seed=seed), tmp_path / name / f"{seed}.csv")
    words = [
        "sessions",
        "empty",
        "loaded",
        "--model",
        "two.json",
        "--effect",
        "payload",
        "--json",
        "out.json",
        "--quiet",
    ]
    assert main(words) == 0
    assert "loaded differs from empty in" in capsys.readouterr().out
    rows = {d["parameter"]: d for d in json.loads((tmp_path / "out.json").read_text())["differences"]}
    mass = rows["payload.mass[tip]"]
    assert mass["differs"] and mass["low"] < 0.3 < mass["high"]
    assert not rows["stiffness[shoulder]"]["differs"]
    assert main(["sessions", "empty", "empty", "--model", "two.json"]) == 2
    assert "given twice" in capsys.readouterr().err


def test_intervals_of_differences_hold_the_truth(tmp_path) -> None:
    arm = load_arm(tmp_path)
    held = []
    for seed in range(0, 16, 2):
        sessions = {str(k): [record(arm, "a", NOISE, seed=seed + k)] for k in range(2)}
        held += [d.low <= 0 <= d.high for d in compare_sessions(arm, sessions).differences if d.low is not None]
    assert np.mean(held) >= 0.8 and len(held) >= 24


def test_one_session_is_not_compared(tmp_path) -> None:
    with pytest.raises(CalibrationError, match="at least two sessions"):
        compare_sessions(load_arm(tmp_path), {"one": []})
