import json

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.recordings.sage_csv import is_sage_folder, read_sage_csv


def sage(folder, rows=20, shift=0.0, effort=0.0, joints=("Pitch", "Jaw"), state=None, control=None):
    """A folder as SAGE writes it, 50 Hz; the commands come `shift` s later than the states."""
    folder.mkdir(parents=True, exist_ok=True)
    columns = {"positions": 0.5, "velocities": 0.0, "torques": effort}
    lines = ["type,timestamp," + ",".join(columns)]
    for k in range(rows):
        lists = [json.dumps([value + 0.01 * k * (value != 0)] * 2) for value in columns.values()]
        lines.append(f"STATE_MOTOR,{20000.0 * k}," + ",".join(f'"{text}"' for text in lists))
    for number, line in (state or {}).items():
        lines[number] = line
    (folder / "state_motor.csv").write_text("\n".join(lines))
    lines = ["type,timestamp,positions"]
    lines += [f'CONTROL,{20000.0 * k + 1e6 * shift},"[{k}.0, {-k}.0]"' for k in range(rows)]
    for number, line in (control or {}).items():
        lines[number] = line
    (folder / "control.csv").write_text("\n".join(lines))
    (folder / "joint_list.txt").write_text("\n".join(joints) + "\n")
    return folder


def test_a_folder_is_one_recording(tmp_path):
    recording = read_sage_csv(sage(tmp_path / "ramp_3", effort=1.0))
    assert recording.joints == ("Pitch", "Jaw") and recording.name == "ramp_3" and recording.kind == "ramp"
    assert recording.hz == pytest.approx(50) and recording.time[1] == pytest.approx(0.02)
    assert recording.command[:, 0].tolist() == list(range(20)) and recording.command[3, 1] == -3
    assert recording.velocity is None and recording.effort[0].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("shift", "hold", "expected"), [(0.005, "unknown", 4), (0.005, "linear", 4.75), (-0.005, "hold", 5)]
)
def test_commands_are_brought_to_the_times_of_the_states(tmp_path, shift, hold, expected):
    recording = read_sage_csv(sage(tmp_path / "a", shift=shift), hold)
    assert recording.command[5, 0] == pytest.approx(expected)
    assert recording.command[0, 0] == pytest.approx(0.25 if (shift, hold) == (-0.005, "linear") else 0)
    assert recording.command_hold == hold


BAD = {
    "list": (
        {"state": {3: 'STATE_MOTOR,40000.0,"[1.0, x]","[0,0]","[0,0]"'}},
        "positions on line 4 is not a list",
    ),
    "code": (
        {"control": {3: 'CONTROL,40000.0,"__import__(1)"'}},
        "positions on line 4 is not a list of numbers",
    ),
    "number": ({"control": {3: "CONTROL,40000.0,3.0"}}, "positions on line 4 is not a list of numbers"),
    "short row": ({"control": {3: "CONTROL,40000.0"}}, "positions on line 4 is not a list of numbers"),
    "length": ({"control": {3: 'CONTROL,40000.0,"[1.0]"'}}, "1 positions on line 4 for 2 joints"),
    "joints": ({"joints": ("a", "b", "c")}, "2 positions on line 2 for 3 joints"),
    "twice": ({"joints": ("a", "a")}, "a occurs more than once"),
    "nan": ({"control": {3: 'CONTROL,40000.0,"[NaN, 1.0]"'}}, "command of Pitch is nan at row 2"),
    "time": ({"state": {3: 'STATE_MOTOR,,"[1,1]","[0,0]","[0,0]"'}}, "line 4 has no time in microseconds"),
    "nan time": (
        {"control": {3: 'CONTROL,nan,"[1,1]"'}},
        "time is not finite, repeats or runs backwards at row",
    ),
    "backwards": (
        {"control": {3: 'CONTROL,1.0,"[1,1]"'}},
        "time is not finite, repeats or runs backwards at row 2",
    ),
    "huge": ({"control": {3: f'CONTROL,40000.0,"[1{"0" * 400}, 1]"'}}, "positions on line 4 is not a list of numbers"),
    "deep": ({"control": {3: f'CONTROL,40000.0,"{"[" * 9000}"'}}, "positions on line 4 is not a list of numbers"),
    "header": (
        {"control": {0: "type,time,positions"}},
        "no column timestamp in the header 'type,time,positions'",
    ),
    "few": ({"rows": 9}, "at least 10 samples"),
    "none": ({"rows": 0}, "no row below the header"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_folders_are_named_in_one_sentence(tmp_path, case):
    given, message = BAD[case]
    with pytest.raises(RecordingError, match=message) as caught:
        read_sage_csv(sage(tmp_path / "bad", **given))
    assert "/bad" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["control.csv", "state_motor.csv", "joint_list.txt"])
def test_a_missing_file_is_named(tmp_path, name):
    folder = sage(tmp_path / "a")
    (folder / name).unlink()
    assert is_sage_folder(folder)
    with pytest.raises(RecordingError, match=f"{name}, which is missing"):
        load_recordings(folder)


def test_a_published_log_reads_like_its_conversion(shared_data):
    folder = shared_data / "so101_sage"
    for name in ("backlash_detection", "friction_gravity"):
        raw, converted = load_recordings(folder / "raw" / name, folder / f"{name}.hdf5")
        assert raw.name == converted.name == name
        for signal in ("time", "position", "command", "velocity", "effort"):
            a, b = getattr(raw, signal), getattr(converted, signal)
            assert np.abs(a - b).max() < 1e-5, signal
        step = 2 * np.pi / 4096
        assert converted.quantum[:5] == pytest.approx(np.full(5, step), rel=1e-3)
        assert np.all(converted.noise < step)


@pytest.mark.parametrize("name", ["control.csv", "state_motor.csv", "joint_list.txt"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"type,timestamp,positions\nX,0,\xff\n", "it is not UTF-8 text"),
        (b"x" * 2_000_000, "a line has 1000000 characters or more"),
        (b"", "names 0 joints|no column timestamp"),
        (b'"' + b"x" * 200_000, "not a readable csv|names 1 joints|no column|for 1 joints"),
    ],
)
def test_a_damaged_file_is_named(tmp_path, name, content, message):
    folder = sage(tmp_path / "a")
    (folder / name).write_bytes(content)
    with pytest.raises(RecordingError, match=message) as caught:
        load_recordings(folder)
    assert (name in str(caught.value) or "for 1 joints" in str(caught.value)) and "\n" not in str(caught.value)
