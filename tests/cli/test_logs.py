"""Logs as people have them, through the command: sets of episodes, motor units, gears, zeros."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.cli import main
from embodiedreamer_gym.recordings import save_recording
from tests.two_joint_arm import load_arm, record, write_arm

pytest.importorskip("pyarrow", reason="LeRobot sets need pyarrow")


def error(*words: str) -> float:
    """Error of a comparison, rad."""
    assert main(["compare", *words, "--quiet", "--json", "answer.json"]) == 0
    return max(row["rms"] for row in json.loads(Path("answer.json").read_text())["table"] if row["regime"] == "all")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_lerobot_set_in_degrees_with_a_reversed_and_shifted_joint(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from embodiedreamer_gym.recordings.episodes import LeRobotWriter

    model = load_arm(here)
    with LeRobotWriter("set", 100, ["shoulder.pos", "elbow.pos"]) as writer:
        for seed in range(2):
            log = record(model, seed=seed)
            turned = [np.degrees(x * [1, -1] + [0.2, 0]) for x in (log.position, log.command)]
            writer.add_episode(*turned, {}, "wave")
    words = (
        "--model",
        "two.json",
        "--hold",
        "linear",
        "--units",
        "degrees",
        "--reverse",
        "elbow",
        "--zero",
        "shoulder=0.2",
    )
    assert error("set:1", *words) < 1e-5
    assert error("set", "--episodes", "0", *words) < 1e-5
    assert error("set", *words[:-1], "shoulder=1.2") > 1e-3
    assert main(["compare", "set", "--model", "two.json"]) == 2
    assert "give --units rad" in capsys.readouterr().err
    assert main(["compare", "set", *words[:-1], "elbow"]) == 2 and "elbow=1.57" in capsys.readouterr().err
    assert main(["compare", "set", *words[:-1], "knee=1"]) == 2 and "not one of the motors" in capsys.readouterr().err


def test_a_log_of_geared_motors_in_ticks(here: Path) -> None:
    write_arm(here, transmission={"motors": ["m1", "m2"], "matrix": [[1e-3, 0], [1e-3, -2e-3]], "zero": {"m1": 2048}})
    log = record(load_arm(here))
    write_arm(here, transmission={"motors": ["m1", "m2"], "matrix": [[1e-3, 0], [1e-3, -2e-3]], "zero": {"m1": 2048}})
    ticks = [
        np.linalg.solve([[1e-3, 0], [1e-3, -2e-3]], x.T).T + np.array([2048, 0]) for x in (log.position, log.command)
    ]
    one = log.with_(joints=("m1", "m2"), position=ticks[0], command=ticks[1], effort=None, noise=np.ones(2))
    save_recording(one, "ticks.csv")
    assert error("ticks.csv", "--model", "two.json") < 1e-9


def test_a_robot_at_rest_cannot_be_fitted(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = record(load_arm(here), seed=0)
    still = log.with_(
        position=np.tile(log.position[:1], (len(log.time), 1)), command=np.tile(log.command[:1], (len(log.time), 1))
    )
    save_recording(still.with_(velocity=None, effort=None), "still.csv")
    assert main(["calibrate", "still.csv", "--model", "two.json", "--out", "fit.json", "--quiet"]) == 2
    assert "no joint moves by 0.01 rad or more in still.csv" in capsys.readouterr().err
    assert not Path("fit.json").exists()
    assert main(["compare", "still.csv", "--model", "two.json", "--quiet"]) == 0


def test_an_assumed_command_hold_is_reported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_recording(record(load_arm(here), seed=0).with_(command_hold="unknown"), "log.csv")
    write_arm(here, "two", command_hold="unknown")
    for options, reported in ((["--hold", "linear"], False), ([], True)):
        assert main(["compare", "log.csv", "--model", "two.json", "--quiet", *options]) == 0
        assert ("command_hold is unknown" in capsys.readouterr().err) == reported
