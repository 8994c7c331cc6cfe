"""LeRobot sets as recordings: numbers, units, choice of episodes, and what is refused."""

from __future__ import annotations

import json
from math import pi
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import load_recordings, preflight
from embodiedreamer_gym.recordings.episode_choice import parse_episodes
from embodiedreamer_gym.recordings.episodes import LeRobotWriter, open_episodes
from embodiedreamer_gym.recordings.lerobot_log import check_command
from embodiedreamer_gym.recordings.motor_units import MotorCalibration, MotorUnits, read_motor_calibration

parquet = pytest.importorskip("pyarrow.parquet", reason="LeRobot sets need pyarrow")
JOINTS = ("base", "shoulder", "elbow", "gripper")
TURN = 2 * pi / 4096


@pytest.fixture
def folder(tmp_path: Path, make) -> Path:
    """Three episodes of three joints and a gripper, 50 Hz, in rad."""
    with LeRobotWriter(tmp_path / "set", 50, [f"{joint}.pos" for joint in JOINTS]) as writer:
        for seed in range(3):
            log = make(seed=seed)
            writer.add_episode(log.position[:100], log.command[:100], {}, "move")
    return tmp_path / "set"


def as_v2(folder: Path, version: str = "v2.1") -> Path:
    """The set as LeRobot 0.3 and before wrote it: one table an episode, JSON lines in meta."""
    table = parquet.read_table(folder / "data/chunk-000/file-000.parquet")
    target = folder.with_name("v2")
    (target / "meta").mkdir(parents=True)
    (target / "data/chunk-000").mkdir(parents=True)
    episodes = table["episode_index"].to_numpy()
    lines = []
    for k in np.unique(episodes):
        rows = table.filter(episodes == k)
        parquet.write_table(rows, target / f"data/chunk-000/episode_{k:06d}.parquet")
        lines.append(json.dumps({"episode_index": int(k), "tasks": ["move"], "length": rows.num_rows}))
    (target / "meta/episodes.jsonl").write_text("\n".join(lines) + "\n")
    info = json.loads((folder / "meta/info.json").read_text())
    info |= {"codebase_version": version, "chunks_size": 1000, "video_path": None,
             "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"}  # fmt: skip
    (target / "meta/info.json").write_text(json.dumps(info))
    return target


def test_state_is_the_position_and_action_the_command(folder: Path, make) -> None:
    logs = load_recordings(folder, units="rad")
    assert [one.name for one in logs] == [f"set_episode_{k}" for k in range(3)]
    for seed, one in enumerate(logs):
        truth = make(seed=seed)
        assert one.joints == JOINTS and one.nominal_time and one.velocity is None and one.effort is None
        assert np.array_equal(one.time, np.arange(100) / 50)
        assert np.array_equal(one.position, truth.position[:100].astype(np.float32))
        assert np.array_equal(one.command, truth.command[:100].astype(np.float32))
    assert [f.code for f in preflight(logs[0]).findings if "time" in f.code] == ["nominal-time"]


@pytest.mark.parametrize("version", ["v2.0", "v2.1"])
def test_older_sets_hold_the_same(folder: Path, version: str) -> None:
    older = load_recordings(as_v2(folder, version), units="rad")
    for a, b in zip(older, load_recordings(folder, units="rad"), strict=True):
        assert np.array_equal(a.position, b.position) and np.array_equal(a.command, b.command)
    assert open_episodes(folder.with_name("v2")).lengths == (100, 100, 100)


@pytest.mark.parametrize(
    ("line", "message"), [("{", "line 2 is not JSON"), ("3", "line 2 is not an object"), ("{}", "numbered from 0")]
)
def test_older_sets_that_are_damaged(folder: Path, line: str, message: str) -> None:
    path = as_v2(folder) / "meta/episodes.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], line, *lines[2:]]))
    with pytest.raises(RecordingError, match=message):
        load_recordings(path.parent.parent, units="rad")


def test_episodes_are_chosen_by_a_suffix_or_for_all(folder: Path) -> None:
    def names(*patterns: str, **more) -> list[str]:
        return [one.name[-1] for one in load_recordings(*patterns, units="rad", **more)]

    assert names(f"{folder}:0,2") == ["0", "2"] and names(f"{folder}:1-2") == ["1", "2"]
    assert names(str(folder), episodes="1") == ["1"] and names(f"{folder}:0", episodes="1") == ["0"]
    assert names(f"{folder}:2", f"{folder}:0-2") == ["2", "0", "1"] and names(f"{folder}:2", str(folder)) == [
        "0",
        "1",
        "2",
    ]
    assert names(f"{folder.parent}/s*:1") == ["1"]


@pytest.mark.parametrize(("text", "numbers"), [("0", (0,)), ("3-5,4,1", (3, 4, 5, 1)), (" 2 - 3 , 0", (2, 3, 0))])
def test_a_choice_of_episodes(text: str, numbers: tuple[int, ...]) -> None:
    assert parse_episodes(text) == numbers


@pytest.mark.parametrize("text", ["", "a", "3-1", "1,,2", "-1", "1-", "0-999999", "1" * 30, "１"])
def test_what_is_no_choice_of_episodes(text: str) -> None:
    with pytest.raises(RecordingError, match="episodes"):
        parse_episodes(text)


def test_joints_are_found_by_name_and_the_rest_is_left_out(folder: Path) -> None:
    one = load_recordings(f"{folder}:0", units="rad", joints=["elbow", "base"])[0]
    assert one.joints == ("elbow", "base") and one.notes == (
        "shoulder, gripper of the log are not joints of the model and were left out",
    )
    with pytest.raises(RecordingError, match="asked for wrist; it has the joints base, shoulder, elbow, gripper"):
        load_recordings(f"{folder}:0", units="rad", joints=["wrist"])


def test_velocity_and_effort_are_read_by_their_names(tmp_path: Path, make) -> None:
    log = make()
    names = [f"main_{joint}.{end}" for joint in JOINTS for end in ("pos", "vel", "torque")] + ["speed.x"]
    state = np.stack([log.position, log.velocity, log.effort], axis=2).reshape(len(log.time), -1)
    with LeRobotWriter(tmp_path / "set", 50, names) as writer:
        writer.add_episode(np.column_stack([state, log.time]), log.command, {}, "move")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    info["features"]["action"]["names"] = {"motors": [f"main_{joint}.pos" for joint in reversed(JOINTS)]}
    (tmp_path / "set/meta/info.json").write_text(json.dumps(info))
    one = load_recordings(tmp_path / "set", units="rad", joints=JOINTS)[0]
    assert np.array_equal(one.velocity, log.velocity.astype(np.float32))
    assert np.array_equal(one.effort, log.effort.astype(np.float32))
    assert np.array_equal(one.command, log.command[:, ::-1].astype(np.float32))


def ticks(values: np.ndarray, motor: MotorCalibration, kind: str) -> np.ndarray:
    """What LeRobot's bus makes of ticks; formulas of `MotorsBus._normalize`."""
    share = (values - motor.low) / (motor.high - motor.low)
    if kind == "0..100":
        return 100 - 100 * share if motor.inverted else 100 * share
    if kind == "range":
        return (100 - 200 * share) if motor.inverted else 200 * share - 100
    return (values - (motor.low + motor.high) / 2) * 360 / 4095


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("kind", ["range", "degrees-middle"])
def test_lerobots_units_become_the_angles_of_the_motor(kind: str, inverted: bool) -> None:
    motor = MotorCalibration(820, 3310, inverted)
    units = MotorUnits(kind, {"elbow": motor, "gripper": motor}, {"elbow": (-1.5, 1.7), "gripper": (-0.2, 1.6)})
    at = np.array([900.0, 2065.0, 3000.0])
    scale, offset, _ = units.line("elbow", "so101_follower", "set")
    assert np.allclose(ticks(at, motor, kind) * scale + offset, (at - 2065) * TURN + 0.1, atol=1e-12)
    scale, offset, _ = units.line("gripper", "so101_follower", "set")
    assert np.allclose(ticks(at, motor, "0..100") * scale + offset, (at - 820) * TURN - 0.2, atol=1e-12)


def test_dynamixels_drive_mode_is_not_applied_and_a_whole_turn_has_no_middle() -> None:
    units = MotorUnits("range", {"elbow": MotorCalibration(1000, 3000, True), "roll": MotorCalibration(0, 4095, False)},
                       {"elbow": (-1.5, 1.5), "roll": (-2.0, 2.6)})  # fmt: skip
    assert units.line("elbow", "koch_follower", "set")[0] > 0 > units.line("elbow", "so100", "set")[0]
    assert units.line("roll", "so100", "set")[1] == 0.0


def test_a_gripper_without_calibration() -> None:
    assert MotorUnits("degrees", normalised=frozenset({"jaw"})).line("jaw", "", "set") == (0.01, 0.0, "")
    scale, offset, note = MotorUnits("degrees", limits={"gripper": (-0.2, 1.8)}).line("gripper", "", "set")
    assert (scale, offset) == (pytest.approx(0.02), -0.2) and "limits" in note
    for joint, kind in (("gripper", "degrees"), ("elbow", "range")):
        with pytest.raises(RecordingError, match="--motor-calibration"):
            MotorUnits(kind).line(joint, "", "set")


@pytest.mark.parametrize(
    ("factor", "likely"), [(1.0, "resembles rad;"), (120.0, r"-100 \.\. 100"), (300.0, "LeRobot's degrees;")]
)
def test_units_are_asked_for(tmp_path: Path, make, factor: float, likely: str) -> None:
    log = make()
    with LeRobotWriter(tmp_path / "set", 50, JOINTS) as writer:
        writer.add_episode(log.position * factor, log.command * factor, {})
    with pytest.raises(RecordingError, match=f"does not state the units.*span -.*{likely}"):
        load_recordings(tmp_path / "set")
    if factor > 100:
        with pytest.raises(RecordingError, match="cannot be in the units 'rad'"):
            load_recordings(tmp_path / "set", units="rad")


@pytest.mark.parametrize(
    ("shift", "what"), [(0, "the state of the same step"), (1, "the next state"), (3, "the state 3 steps later")]
)
def test_an_action_that_is_a_state_is_no_command(make, shift: int, what: str) -> None:
    x = make().position
    action = np.concatenate([x[shift:], np.repeat(x[-1:], shift, axis=0)]).astype(np.float32)
    with pytest.raises(
        RecordingError, match=rf"set: its action is {what} \(they differ by at most .*correlation 1\.0000"
    ):
        check_command(x, action, "set")
    with pytest.raises(RecordingError, match="change of the state"):
        check_command(x, np.diff(x, axis=0, append=x[-1:]), "set")
    check_command(x, make().command, "set")


def test_a_close_follower_is_believed(make) -> None:
    """A stiff servo without delay, whose sensor has an encoder's step."""
    log = make(delay=0.0, sag=0.0)
    step = 2 * pi / 4096
    check_command(np.round(log.command / step) * step, log.command, "set")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([], "object of motors"), ({"homing_offset": [1, 2]}, "object of motors"),
        ({"a": {"range_min": 5, "range_max": 5, "drive_mode": 0}}, "range_min < range_max"),
        ({"a": {"range_min": 5, "range_max": 9.5, "drive_mode": 0}}, "range_min < range_max"),
        ({"a": {"range_min": 5, "range_max": 9, "drive_mode": 2}}, "drive_mode of 0 or 1"),
    ],
)  # fmt: skip
def test_a_calibration_file_that_is_none(tmp_path: Path, data: object, message: str) -> None:
    (tmp_path / "c.json").write_text(json.dumps(data))
    with pytest.raises(RecordingError, match=message):
        read_motor_calibration(tmp_path / "c.json")


def test_a_calibration_file_is_read(tmp_path: Path) -> None:
    data = {"elbow": {"id": 3, "drive_mode": 0, "homing_offset": -12, "range_min": 800, "range_max": 3000}}
    (tmp_path / "c.json").write_text(json.dumps(data))
    assert read_motor_calibration(tmp_path / "c.json") == {"elbow": MotorCalibration(800, 3000, False)}


@pytest.mark.parametrize(
    ("pattern", "message"),
    [("{}:3", "there is no episode 3; it has 0 to 2"), ("{}/meta/info.json:0", "not a LeRobot set")],
)
def test_episodes_that_there_are_not(folder: Path, pattern: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        load_recordings(pattern.format(folder), units="rad")
