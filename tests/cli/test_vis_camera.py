"""The command that finds a camera: files in, camera file and pictures out."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.cli.command import execute
from embodiedreamer_gym.envs.cameras import load_cameras, save_cameras
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.recordings import Recording, save_recording
from tests.vis_aligner.camera_calibration.conftest import TRUTH, apart, film, motion, surface

ROWS = 12
ALOHA = surface().joints


def run(*arguments: object) -> None:
    execute(["vis", "camera", *map(str, arguments), "--quiet"])


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One recording with frames, one without but with a video, masks, a first guess, and marks."""
    folder = tmp_path_factory.mktemp("logs")
    angles = motion(rows=ROWS)
    frames, masks = film(TRUTH, angles)
    log = Recording("shot", ALOHA, np.arange(ROWS) / 10, angles, angles, frames={"head": frames})
    save_recording(log, folder / "shot.hdf5")
    save_recording(log.with_(frames={}), folder / "blind.csv")
    video = cv2.VideoWriter(str(folder / "blind.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, TRUTH.size)
    for frame in frames:
        video.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    video.release()
    (folder / "masks").mkdir()
    for t, mask in enumerate(masks):
        cv2.imwrite(str(folder / "masks" / f"{t:03d}.png"), 255 * mask.astype(np.uint8))
    save_cameras([TRUTH.with_(name="guess", position=tuple(np.add(TRUTH.position, 0.02)))], folder / "guess.json")
    pixels = [(k, TRUTH) for k in range(ROWS)]
    points = surface().body
    part = points.names.index("left_link4")
    vertex = points.vertices[points.part == part][0].astype(float)
    where = surface().locate("left_link4", np.tile(vertex, (ROWS, 1)), angles)
    position, rotation = TRUTH.pose()
    seen = (where - position) @ rotation @ TRUTH.matrix().T
    marks = [
        {"recording": "shot", "frame": k, "link": "left_link4", "point": vertex.tolist(),
         "pixel": (seen[k, :2] / seen[k, 2]).tolist(), "sd": 0.5}
        for k, _ in pixels
    ]  # fmt: skip
    marks.append({**marks[0], "recording": "of another day"})
    (folder / "marks.json").write_text(json.dumps({"marks": marks}))
    return folder


def found(path: Path, name: str) -> float:
    return apart(load_cameras(path)[name], TRUTH, motion(rows=ROWS))


def test_a_first_guess_becomes_a_camera(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("--model", "aloha", logs / "shot.hdf5", "--start", logs / "guess.json", "--out", tmp_path / "c.json",
        "--json", tmp_path / "all.json", "--overlay", tmp_path / "look")  # fmt: skip
    assert found(tmp_path / "c.json", "head") < 1.0  # the name of the recordings' camera
    text = capsys.readouterr().out
    assert "lens at 240 x 180" in text and "green must lie on the robot's edge" in text
    assert json.loads((tmp_path / "all.json").read_text())["stands"][0]["outline"] < 1.0
    assert cv2.imread(str(tmp_path / "look" / "shot.png")) is not None


def test_marks_and_masks_from_files(logs: Path, tmp_path: Path) -> None:
    run("--model", "aloha", logs / "shot.hdf5", "--marks", logs / "marks.json", "--masks", logs / "masks",
        "--camera", "head", "--loose", "left_link6", "--out", tmp_path / "c.json")  # fmt: skip
    assert found(tmp_path / "c.json", "head") < 1.5


def test_a_log_beside_a_video(logs: Path, tmp_path: Path) -> None:
    """And a bare URDF in place of a model."""
    from embodiedreamer_gym.robot import RobotModel

    run("--model", RobotModel.load("aloha").urdf, "--joints", ",".join(ALOHA), logs / "blind.csv", "--video",
        logs / "blind.mp4", "--start", logs / "guess.json", "--free", "focal", "--out", tmp_path / "c.json")  # fmt: skip
    assert found(tmp_path / "c.json", "camera") < 1.5


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--model", "aloha", "blind.csv"], "blind: the recording has no frames; give --video FILE"),
        (["--model", "aloha", "shot.hdf5", "--camera", "wrist"], "there is no camera 'wrist'; it has head"),
        (["--model", "aloha", "shot.hdf5", "--joints", "a"], "--joints is only for a .urdf"),
        (["--model", "arm.urdf", "shot.hdf5"], "arm.urdf is a URDF; name the logs' columns with --joints"),
        (["--model", "aloha", "shot.hdf5", "--masks", "."], r"holds 0 masks, but shot has 12 frames"),
        (["--model", "aloha", "shot.hdf5", "--video", "a.mp4", "b.mp4"], "2 videos for 1 recordings"),
        (["--model", "aloha", "shot.hdf5", "--marks", "shot.hdf5"], "is not readable JSON"),
        (["--model", "aloha", "shot.hdf5", "--marks", "guess.json"], r"must be {\"marks\""),
        (["--model", "aloha", "shot.hdf5", "--start", "shot.hdf5"], "is not readable JSON"),
        (["--model", "aloha", "shot.hdf5", "--out", "none/c.json"], "folder .*none does not exist"),
        (["--model", "aloha", "shot.hdf5", "--seed", "-1"], "--seed: -1 is not a whole number from 0 to"),
        (["--model", "aloha", "missing.hdf5"], "missing.hdf5: there is no such file"),
    ],
)
def test_mistakes_are_one_sentence(
    logs: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], sentence: str
) -> None:
    monkeypatch.chdir(logs)
    given = arguments if "--out" in arguments else [*arguments, "--out", "c.json"]
    with pytest.raises(EmbodieDreamerError, match=sentence) as raised:
        run(*given)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"frame": 99}, "number 0: shot has no frame 99"),
        ({"frame": True}, "number 0: shot has no frame true"),
        ({"frame": 10**30}, "number 0: shot has no frame 10000"),
        ({"pixel": [1, "2"]}, "number 0: pixel must be 2 finite numbers"),
        ({"pixel": [1, 1e300]}, "number 0: pixel must be 2 finite numbers"),
        ({"point": [10**400, 0, 0]}, "number 0: point must be 3 finite numbers, not .Infinity"),
        ({"sd": float("nan")}, "number 0: sd must be 1 finite numbers"),
        ({"sd": 10**30}, "number 0: sd must be 1 finite numbers"),
        ({"link": 10**30}, "number 0: link must be the name of a link, not 10000"),
        ({"link": "tail"}, "m.json, number 0: the robot has no visible link 'tail'"),
        ({"recording": "none"}, "belongs to one of the recordings shot"),
    ],
)
def test_marks_that_do_not_fit_are_named(logs: Path, tmp_path: Path, change: dict, sentence: str) -> None:
    mark = json.loads((logs / "marks.json").read_text())["marks"][0] | change
    (tmp_path / "m.json").write_text(json.dumps({"marks": [mark]}))
    with pytest.raises(EmbodieDreamerError, match=sentence) as raised:
        run("--model", "aloha", logs / "shot.hdf5", "--marks", tmp_path / "m.json", "--out", tmp_path / "c.json")
    assert "\n" not in str(raised.value) and len(str(raised.value)) < 400


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"fx": 10**400}, "fx is inf, not a finite number"),
        ({"cy": -1e300}, "cy is -1e.300, not a finite number of at most 1e.06"),
        ({"position": [1e308, 0, 0]}, "position needs 3 finite numbers"),
        ({"size": 10**300}, "size must be a list of numbers, not 1e.300"),
        ({"near": float("nan")}, "near is nan"),
    ],
)
def test_a_start_that_is_no_camera_is_named(logs: Path, tmp_path: Path, change: dict, sentence: str) -> None:
    camera = {"position": [1, 0, 1], "rotation": [0, 0, 0, 1], "size": [64, 48], "fx": 60, "fy": 60, "cx": 31, "cy": 23}
    (tmp_path / "s.json").write_text(json.dumps({"cameras": {"head": camera | change}}))
    with pytest.raises(EmbodieDreamerError, match=sentence) as raised:
        run("--model", "aloha", logs / "shot.hdf5", "--start", tmp_path / "s.json", "--out", tmp_path / "c.json")
    assert "\n" not in str(raised.value) and len(str(raised.value)) < 400
