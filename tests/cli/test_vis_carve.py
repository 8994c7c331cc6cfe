"""`vis carve`: what it says of bad input, and that it writes nothing then."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording, save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.carved_urdf import add_visual
from embodiedreamer_gym.robot.surface import Surface

TRIANGLE = np.eye(3), np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--link", "nose"], "the robot has no link 'nose'; it has"),
        (["--link", "left_link6"], "moves in none of the recordings"),
        (["--link", "left_link6", "--camera", "left_wrist"], "there is no camera 'left_wrist'; it has head"),
        (["--link", "left_link6", "--camera", "nose"], "no camera is named 'nose'; give one of head"),
        (["--link", "left_link6", "--cameras", "c.json"], "no camera is named 'head' or 'head/still'; there are top"),
        (["--link", "left_link6", "--out", "robot.urdf"], "give a file name.json"),
        (["--link", "left_link6", "--reach", "9"], "--reach: 9 is not a number from 0.05 to 0.5"),
        (["--link", "left_link6", "--joints", "a"], "--joints is only for a .urdf"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    from embodiedreamer_gym.envs.cameras import CAMERAS, save_cameras

    monkeypatch.chdir(tmp_path)
    model, angles = RobotModel.load("aloha"), np.zeros((12, 14))
    angles[:, 8] = np.sin(np.arange(12))  # of the other arm
    log = Recording("still", model.joints, np.arange(12) / 3, angles, angles, units=model.units,
                    frames={"head": np.zeros((12, 48, 64, 3), np.uint8)})  # fmt: skip
    save_recording(log, tmp_path / "still.hdf5")
    save_cameras([CAMERAS["head"].with_(name="top")], tmp_path / "c.json")
    given = ["vis", "carve", "still.hdf5", "--model", "aloha", "--out", "robot.json", "--quiet", *arguments]
    assert main(given) == 2
    error = capsys.readouterr().err
    assert sentence in error and error.count("\n") == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.json", "still.hdf5"]


def test_a_shape_is_added_once_and_the_robot_stays_what_it_is(tmp_path: Path) -> None:
    model = RobotModel.load("aloha")
    for size in (0.5, 0.1):
        add_visual(model.urdf, "left_link6", size * TRIANGLE[0], TRIANGLE[1], (1.0, 0.0, 0.0), tmp_path / "a.urdf")
        model = model.with_(urdf=tmp_path / "a.urdf")
    model.save(tmp_path / "a.json")
    again, plain = (Surface.of_model(RobotModel.load(source)).body for source in (tmp_path / "a.json", "aloha"))
    assert len(again.faces) == len(plain.faces) + 1 and again.names == plain.names
    added = again.vertices[again.part == again.names.index("left_link6")][-3:]
    assert np.allclose(added, 0.1 * np.eye(3), atol=1e-6)
    with pytest.raises(ModelError, match="has no link 'tail'"):
        add_visual(model.urdf, "tail", *TRIANGLE, (1.0, 0.0, 0.0), tmp_path / "b.urdf")
    assert not (tmp_path / "b.urdf").exists()
