"""`embodiedreamer track`: commands for a trajectory of the user's."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.cli import main
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.recordings.plain_csv import read_commands
from tests.two_joint_arm import write_arm

LOG = DATA / "test" / "teleoperation-3.hdf5"


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    """A csv that names the wanted positions as commands, for the two-joint arm."""
    time = np.arange(0, 1.5, 0.02)
    place = 0.3 * np.sin(2 * time)
    path = tmp_path / "wanted.csv"
    np.savetxt(path, np.column_stack([time, place, -place]), "%.6f", ",", comments="",
               header="time,shoulder.command,elbow.command")  # fmt: skip
    write_arm(tmp_path)
    return path


def test_commands_and_the_expected_errors(trajectory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, numbers = tmp_path / "out.csv", tmp_path / "out.json"
    given = ["track", str(trajectory), "--model", str(tmp_path / "two.json"), "--out", str(out), "--json", str(numbers)]
    assert main([*given, "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "expected tracking error" in shown and str(out) in shown
    joints, time, command = read_commands(out)
    assert joints == ("shoulder", "elbow") and command.shape == (75, 2) and time[-1] == pytest.approx(1.48)
    for one in json.loads(numbers.read_text())["joints"].values():
        assert one["after"] < 0.1 * one["before"]


def test_a_transmission_gets_the_motors_commands(trajectory: Path, tmp_path: Path) -> None:
    """Of the same arm, whose elbow's motor counts in the opposite direction."""
    plain, turned = tmp_path / "plain.csv", tmp_path / "turned.csv"
    given = ["--model", str(tmp_path / "two.json"), "--quiet", "--out"]
    assert main(["track", str(trajectory), *given, str(plain)]) == 0
    text = trajectory.read_text().splitlines()
    rows = [[float(x) for x in line.split(",")] for line in text[1:]]
    trajectory.write_text("\n".join([text[0], *(f"{t:.6f},{a:.6f},{-b:.6f}" for t, a, b in rows)]) + "\n")
    assert main(["track", str(trajectory), *given, str(turned), "--reverse", "elbow"]) == 0
    assert np.allclose(read_commands(turned)[2], read_commands(plain)[2] * [1, -1], atol=2e-6)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ([str(DATA / "test"), "--model", "MODEL"], "holds 2 recordings; give one trajectory at a time"),
        ([str(LOG), "--model", "two"], "asked for shoulder, elbow|has the joints|joints"),
        (["no.csv", "--model", "MODEL"], "no such file"),
        (["TRAJECTORY", "--model", "MODEL"], "asked for joint1"),
    ],
)
def test_bad_input_is_one_sentence(
    given: list[str], sentence: str, trajectory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"MODEL": str(DATA / "model.json"), "two": str(tmp_path / "two.json"), "TRAJECTORY": str(trajectory)}
    assert main(["track", *(names.get(word, word) for word in given), "--out", str(tmp_path / "o.csv"), "--quiet"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("error: ")
    assert re.search(sentence, error), error
    assert not (tmp_path / "o.csv").exists()


def test_guessed_gains_are_said(trajectory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = json.loads((tmp_path / "two.json").read_text())
    data.pop("servo", None)
    (tmp_path / "bare.json").write_text(json.dumps(data))
    given = ["track", str(trajectory), "--quiet", "--out", str(tmp_path / "out.csv"), "--model"]
    assert main([*given, str(tmp_path / "bare.json")]) == 0
    assert "gains of the model are guessed" in capsys.readouterr().err
    assert main([*given, str(tmp_path / "two.json")]) == 0
    assert "guessed" not in capsys.readouterr().err
