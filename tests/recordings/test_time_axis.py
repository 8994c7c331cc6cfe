"""The unit of time stamps: recognised, converted with a note, or asked for in one sentence."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import load_recordings, preflight
from embodiedreamer_gym.recordings.episodes import open_episodes
from embodiedreamer_gym.recordings.time_axis import TIME_UNITS, column_unit, find_clock, parse_unit

EPOCH = 1_700_000_000  # s: 2023-11-14
COUNT = 200


def motion(hz: float, count: int = COUNT, speed: float = 1.0) -> np.ndarray:
    """Positions (T, 2) of joints that swing by 0.5 rad, whose fastest moves at `speed` rad/s."""
    time = np.arange(count) / hz
    return np.column_stack([0.5 * np.sin(2 * speed * time), 0.2 * np.sin(speed * time)])


def csv(path: Path, stamps, position: np.ndarray, header: str = "time", comment: str = "", end: str = "\n") -> Path:
    rows = [f"{t!r},{a!r},{a!r},{b!r},{b!r}" for t, (a, b) in zip(stamps, position.tolist(), strict=True)]
    head = f"{header},a.command,a.position,b.command,b.position"
    path.write_bytes((comment + end.join([head, *rows]) + end).encode())
    return path


def hdf5(path: Path, stamps, position: np.ndarray, unit: str | None = None) -> Path:
    with h5py.File(path, "w") as file:
        file["observations/qpos"] = file["action"] = position
        file["timestamps"] = np.asarray(stamps)
        if unit is not None:
            file["timestamps"].attrs["units"] = unit
    return path


def sage(folder: Path, stamps, position: np.ndarray, end: str = "\n") -> Path:
    folder.mkdir()
    rows = [f'X,{t!r},"[{a}, {b}]"' for t, (a, b) in zip(stamps, position.tolist(), strict=True)]
    for name in ("control.csv", "state_motor.csv"):
        (folder / name).write_bytes(end.join(["type,timestamp,positions", *rows, ""]).encode())
    (folder / "joint_list.txt").write_bytes(f"a{end}b{end}".encode())
    return folder


WRITERS = {"csv": (csv, "a.csv"), "hdf5": (hdf5, "a.hdf5"), "sage": (sage, "a")}


def write(form: str, tmp_path: Path, stamps, position: np.ndarray) -> Path:
    return WRITERS[form][0](tmp_path / WRITERS[form][1], stamps, position)


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("hz", [30.0, 500.0])
@pytest.mark.parametrize("unit", TIME_UNITS)
def test_each_unit_is_recognised(tmp_path: Path, form: str, unit: str, hz: float) -> None:
    stamps = (np.arange(COUNT) / hz / TIME_UNITS[unit]).tolist()
    recording = load_recordings(write(form, tmp_path, stamps, motion(hz)))[0]
    np.testing.assert_allclose(recording.time, np.arange(COUNT) / hz, rtol=1e-9, atol=1e-12)
    usual = "us" if form == "sage" else "s"
    assert len(recording.notes) == (unit != usual)
    found = [f.message for f in preflight(recording).findings if f.code == "converted"]
    assert found == list(recording.notes) and all(f"seconds ({'' if unit == 's' else 'a step'}" for _ in found)


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("unit", TIME_UNITS)
def test_times_since_1970_are_counted_from_the_first_sample(tmp_path: Path, form: str, unit: str) -> None:
    ticks = (
        (EPOCH + np.arange(COUNT) * 0.02)
        if unit == "s"
        else (EPOCH * 50 + np.arange(COUNT)) * round(0.02 / TIME_UNITS[unit])
    )
    recording = load_recordings(write(form, tmp_path, ticks.tolist(), motion(50)))[0]
    np.testing.assert_allclose(recording.time, np.arange(COUNT) * 0.02, atol=1e-6)
    assert len(recording.notes) == 1 and "since 1970 (2023-11-14 22:13:20 UTC)" in recording.notes[0]


def test_whole_nanoseconds_keep_their_digits(tmp_path: Path) -> None:
    stamps = EPOCH * 10**9 + 1_000_001 * np.arange(COUNT)  # as float64 they would be multiples of 256 ns
    recording = load_recordings(hdf5(tmp_path / "a.hdf5", stamps, motion(1000)))[0]
    np.testing.assert_allclose(np.diff(recording.time), 1_000_001e-9, rtol=1e-9)


@pytest.mark.parametrize(
    ("hz", "unit"), [(5.0, "s"), (5000.0, "ms"), (4.0, "ms"), (4000.0, "us"), (0.5, "s"), (500.0, "ms")]
)
def test_speeds_decide_between_two_units(tmp_path: Path, hz: float, unit: str) -> None:
    """A step of 0.2 may be 5 Hz in s or 5 kHz in ms; a joint at 1 rad/s in one of them is absurd in the other."""
    stamps = np.arange(10 * COUNT) / hz / TIME_UNITS[unit]
    position = motion(hz, 10 * COUNT, speed=1.0 if hz > 0.5 else 0.2)
    recording = load_recordings(csv(tmp_path / "a.csv", stamps.tolist(), position))[0]
    assert recording.hz == pytest.approx(hz)


@pytest.mark.parametrize("speed", [0.04, 0.0])
def test_two_plausible_readings_are_a_question(tmp_path: Path, speed: float) -> None:
    path = csv(tmp_path / "a.csv", (np.arange(3 * COUNT) / 5).tolist(), motion(5, 3 * COUNT, speed=speed))
    with pytest.raises(
        RecordingError, match=r"a\.csv: the unit of these times may be seconds or milliseconds:"
    ) as caught:
        load_recordings(path)
    assert "5 Hz in s or 5000 Hz in ms" in str(caught.value) and "--time-unit" in str(caught.value)
    assert load_recordings(path, time_unit="s")[0].hz == pytest.approx(5)
    assert load_recordings(path, time_unit="ms")[0].hz == pytest.approx(5000)
    assert "as given" in load_recordings(path, time_unit="ms")[0].notes[0]


@pytest.mark.parametrize("form", ["csv", "hdf5"])
@pytest.mark.parametrize("step", [1e-9, 1e-6, 1e-5, 2e9])
def test_no_plausible_reading_is_a_question(tmp_path: Path, form: str, step: float) -> None:
    path = write(form, tmp_path, (step * np.arange(COUNT)).tolist(), motion(50))
    with pytest.raises(RecordingError, match=r"the unit of these times is not known: their step of") as caught:
        load_recordings(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("form", WRITERS)
def test_a_gap_of_months_is_refused(tmp_path: Path, form: str) -> None:
    scale = 1e6 if form == "sage" else 1.0
    time = np.arange(COUNT) / 50 + np.where(np.arange(COUNT) > 99, 1e7, 0.0)
    with pytest.raises(RecordingError, match=r"a gap of 1e\+07 s after row 99 .*Split the log there"):
        load_recordings(write(form, tmp_path, (time * scale).tolist(), motion(50)))


def test_a_gap_of_seconds_is_a_finding_still(tmp_path: Path) -> None:
    time = np.arange(COUNT) / 50 + np.where(np.arange(COUNT) > 99, 30.0, 0.0)
    findings = preflight(load_recordings(csv(tmp_path / "a.csv", time.tolist(), motion(50)))[0]).findings
    assert "dropped-samples" in {finding.code for finding in findings}


@pytest.mark.parametrize("end", ["\r", "\n", "\r\n"])
@pytest.mark.parametrize("form", ["csv", "sage"])
def test_bare_carriage_returns_end_lines(tmp_path: Path, form: str, end: str) -> None:
    scale = 1e6 if form == "sage" else 1.0
    stamps = (scale * np.arange(COUNT) / 50).tolist()
    path = WRITERS[form][0](tmp_path / WRITERS[form][1], stamps, motion(50), end=end)
    recording = load_recordings(path)[0]
    assert recording.position.shape == (COUNT, 2) and np.array_equal(recording.position, motion(50))
    assert any("bare carriage returns" in note for note in recording.notes) == (end == "\r")


@pytest.mark.parametrize("header", ["time_ms", "time [ms]", "time(ms)", "timestamp_ms", "Time ms"])
def test_the_columns_name_states_the_unit(tmp_path: Path, header: str) -> None:
    path = csv(tmp_path / "a.csv", (np.arange(COUNT) * 0.2).tolist(), motion(5000, speed=0.0), header)
    recording = load_recordings(path)[0]
    assert recording.hz == pytest.approx(5000) and "as the log states" in recording.notes[0]


def test_comments_and_attributes_state_the_unit(tmp_path: Path) -> None:
    stamps, still = (np.arange(COUNT) * 0.2).tolist(), motion(5000, speed=0.0)
    assert load_recordings(csv(tmp_path / "a.csv", stamps, still, comment="# time_unit: ms\n"))[0].hz == pytest.approx(
        5000
    )
    assert load_recordings(hdf5(tmp_path / "a.hdf5", stamps, still, "milliseconds"))[0].hz == pytest.approx(5000)


def test_episodes_take_their_rate_from_stamps_of_any_unit(tmp_path: Path) -> None:
    episodes = open_episodes(hdf5(tmp_path / "a.hdf5", EPOCH * 1000 + 20 * np.arange(COUNT), motion(50)))
    assert episodes.hz == pytest.approx(50)
    with pytest.raises(RecordingError, match="the unit of these times is not known"):
        open_episodes(hdf5(tmp_path / "b.hdf5", 1e-9 * np.arange(COUNT), motion(50)))


def test_a_control_file_of_another_unit_is_refused(tmp_path: Path) -> None:
    folder = sage(tmp_path / "a", (2e9 + 2e4 * np.arange(COUNT)).tolist(), motion(50))
    text = (folder / "control.csv").read_text().splitlines()
    rows = [f'X,{2e3 + 0.02 * k},"[0, 0]"' for k in range(COUNT)]
    (folder / "control.csv").write_text("\n".join([text[0], *rows]))
    with pytest.raises(RecordingError, match="do not overlap in time"):
        load_recordings(folder)


def test_an_unknown_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="time_unit 'minutes' is not one of s, ms, us, ns"):
        load_recordings(tmp_path, time_unit="minutes")


@pytest.mark.parametrize(
    ("label", "unit"),
    [
        ("ms", "ms"),
        ("Milliseconds", "ms"),
        ("µs", "us"),
        ("sec", "s"),
        ("second", "s"),
        ("nsec", "ns"),
        ("s", "s"),
        ("h", None),
    ],
)
def test_labels_of_units(label: str, unit: str | None) -> None:
    assert parse_unit(label) == unit
    assert column_unit(f"time_{label}") == (unit is not None, unit)


def test_stamps_that_are_not_times_are_left_to_the_recording() -> None:
    for stamps in ([], [1.0], [0.0, np.nan, 2.0], [3.0, 2.0, 1.0], [0.0, 0.0, 0.0]):
        assert find_clock(np.array(stamps), np.zeros((len(stamps), 1)), "a.csv").unit == "s"
