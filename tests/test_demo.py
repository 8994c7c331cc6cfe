"""The demo: small files without the truth, one verdict, and a story told in order."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym import RobotModel, calibrate, cli, compare, demo, load_recordings
from embodiedreamer_gym.demo import DATA, TRUTH
from embodiedreamer_gym.errors import EmbodieDreamerError


@pytest.fixture
def told(shared_demo, tmp_path, capsys) -> tuple[Path, str]:
    """The folder of the demo, run with the shared diagnosis, and what it printed."""
    folder = tmp_path / "deep" / "report"
    assert cli.main(["demo", "--quiet", "--out", str(folder)]) == 0
    return folder, capsys.readouterr().out


def test_the_error_falls_to_the_noise_the_truth_comes_last_and_the_files_work(told) -> None:
    folder, text = told
    found = json.loads((folder / "diagnosis.json").read_text())
    truth = json.loads(TRUTH.read_text())
    assert found["verdict"] == "missing" and found["effects"] == [truth["effect"]]
    hurt = {joint for values in truth["values"].values() for joint in values}
    assert set(found["joints"][truth["effect"]]) == hurt
    error = found["error"]
    assert error["calibrated"] < 0.6 * error["nominal"]
    assert error["with_effect"] < 0.3 * error["calibrated"]
    assert error["with_effect"] < 1.3 * error["noise"]
    stories = ["1 of 5   compare", "2 of 5   calibrate", "3 of 5   diagnose", "4 of 5   add", "5 of 5   compare again"]
    stories += ["The ground truth:", "hidden: stribeck_friction    diagnosed: stribeck_friction", f"report: {folder}"]
    places = [text.index(part) for part in stories]
    assert places == sorted(places)
    assert max(len(line) for line in text.splitlines() if str(folder) not in line) <= 110

    better = RobotModel.load(folder / "better.json")
    comparison = compare(better, load_recordings(folder / "test"))
    error = json.loads((folder / "diagnosis.json").read_text())["error"]["with_effect"]
    assert comparison.error[0] == pytest.approx(error, abs=1e-5)
    page = (folder / "index.html").read_text()
    assert "stribeck friction" in page and "How far the error falls" in page
    assert not (folder / "truth.json").exists()


def test_the_files_are_small_and_readable(tmp_path) -> None:
    assert sum(path.stat().st_size for path in DATA.rglob("*") if path.is_file()) <= 300_000
    folder = demo.unpack(tmp_path / "demo")
    model = RobotModel.load(folder / "model.json")
    assert not (folder / "truth.json").exists() and not model.effects
    train, test = load_recordings(folder / "train"), load_recordings(folder / "test")
    assert {r.kind for r in train} == {"multisine", "point_to_point"}
    assert {r.kind for r in test} == {"teleoperation", "slow_ramps"}
    assert all(r.joints == model.joints and r.command_hold == "linear" for r in (*train, *test))


def test_calibration_alone_does_not_mend_it() -> None:
    model = RobotModel.load(DATA / "model.json")
    train, test = load_recordings(DATA / "train"), load_recordings(DATA / "test")
    comparison = compare([model, calibrate(model, train).model], test)
    nominal, calibrated = comparison.error
    assert 3 * comparison.noise < calibrated < 0.6 * nominal


def test_the_files_can_be_made_again(tmp_path, monkeypatch) -> None:
    pytest.importorskip("mujoco")
    from benchmarks import make_demo_data

    monkeypatch.setattr(sys, "argv", ["make_demo_data", "--out", str(tmp_path)])
    make_demo_data.main()
    for name in ("model.json", "arm6.urdf"):
        assert (tmp_path / name).read_text() == (DATA / name).read_text()
    again, truth = (json.loads((folder / "truth.json").read_text()) for folder in (tmp_path, DATA))
    assert again["effect"] == truth["effect"]
    for key, values in truth["values"].items():
        assert again["values"][key] == pytest.approx(values, rel=1e-3)
    for part in ("train", "test"):
        for old, new in zip(load_recordings(DATA / part), load_recordings(tmp_path / part), strict=True):
            assert old.name == new.name
            np.testing.assert_allclose(new.command, old.command, atol=1e-6)
            np.testing.assert_allclose(new.position, old.position, atol=4e-3)  # two encoder steps


def test_a_folder_that_cannot_be_is_one_sentence(tmp_path, capsys) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(EmbodieDreamerError, match="cannot be written"):
        demo.unpack(tmp_path / "file")
    assert cli.main(["demo", "--out", str(tmp_path / "file" / "deep")]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1
