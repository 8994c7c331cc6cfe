import copy

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import Recording, Recordings
from embodiedreamer_gym.recordings.recording import default_kind


def test_a_recording_fills_in_what_is_not_given(make):
    recording = make(units=(), velocity=None)
    assert recording.units == ("rad",) * 4
    assert recording.kind == "sine"
    assert recording.usable.shape == (600, 4) and recording.usable.all()
    assert recording.noise.shape == recording.quantum.shape == recording.sigma.shape == (4,)
    assert recording.hz == pytest.approx(50) and recording.duration == pytest.approx(599 / 50)
    assert repr(recording) == (
        "Recording('sine_01', kind 'sine', 600 samples, 4 joints, 11.98 s, 50.0 Hz, position+command+effort)"
    )


def test_arrays_are_read_only_copies(make):
    position = np.random.default_rng(0).standard_normal((600, 4)).astype(np.float32)
    recording = make(position=position)
    assert recording.position.dtype == np.float64
    position[:] = 0
    assert np.ptp(recording.position) > 0
    for name in ("time", "position", "command", "noise", "quantum", "usable"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(recording, name)[0] = 1


def test_with_changes_one_field_and_keeps_the_sensor(make):
    recording = make()
    other = recording.with_(position=recording.position + 1, command_hold="linear")
    assert other.command_hold == "linear" and recording.command_hold == "unknown"
    assert np.array_equal(other.noise, recording.noise)
    assert np.array_equal(other.position, recording.position + 1)


def test_sigma_joins_noise_and_rounding(make):
    recording = make(noise=np.full(4, 3e-3), quantum=np.full(4, 4e-3 * np.sqrt(12)))
    assert recording.sigma == pytest.approx(np.full(4, 5e-3))


def test_only_selects_and_orders_joints(make):
    recording = make()
    part = recording.only(["gripper", "base"])
    assert part.joints == ("gripper", "base") and part.units == ("1", "rad")
    assert np.array_equal(part.position, recording.position[:, [3, 0]])
    assert np.array_equal(part.noise, recording.noise[[3, 0]])
    with pytest.raises(RecordingError, match=r"wrist.*base, shoulder"):
        recording.only(["wrist"])


def test_a_recording_can_be_copied_to_another_process(make):
    assert np.array_equal(copy.deepcopy(make()).position, make().position)


def spoilt(name, row, column, value):
    def spoil(recording):
        array = np.array(getattr(recording, name))
        array[(row, column) if array.ndim == 2 else row] = value
        return {name: array}

    return spoil


BAD = {
    "nan": (spoilt("position", 7, 2, np.nan), "position of elbow is nan at row 7"),
    "inf": (spoilt("command", 0, 1, np.inf), "command of shoulder is inf at row 0"),
    "huge": (spoilt("velocity", 5, 3, -1e300), "velocity of gripper is -1e\\+300 at row 5"),
    "nan effort": (spoilt("effort", 3, 0, np.nan), "effort of base is nan at row 3"),
    "nan time": (spoilt("time", 4, 0, np.nan), "time is not finite at row 4"),
    "backwards": (spoilt("time", 9, 0, 0.0), "time runs backwards at row 9"),
    "repeated": (lambda r: {"time": np.repeat(r.time[::2], 2)}, "time repeats at row 1 "),
    "microseconds": (lambda r: {"time": 1e6 * r.time}, "must be in seconds"),
    "few": (lambda r: {"time": r.time[:9], "position": r.position[:9]}, "at least 10 samples"),
    "shapes": (lambda r: {"command": r.command[:, :3]}, r"command has shape \(600, 3\)"),
    "length": (lambda r: {"time": r.time[:-1]}, r"need \(599, 4\)"),
    "text": (lambda r: {"position": [["a"] * 4] * 600}, "position holds something that is not a number"),
    "no position": (lambda r: {"position": None}, "position has shape"),
    "twice": (lambda r: {"joints": ("a", "b", "a", "c")}, "a occurs more than once"),
    "no joint": (lambda r: {"joints": (), "units": ()}, "no joint"),
    "unit": (lambda r: {"units": ("rad", "rad", "rad", "deg")}, "one of rad, m, 1"),
    "units": (lambda r: {"units": ("rad",)}, "each of 4 joints"),
    "hold": (lambda r: {"command_hold": "cubic"}, "linear, hold, unknown"),
    "noise": (lambda r: {"noise": np.ones(3)}, "noise must be 4 numbers"),
    "quantum": (lambda r: {"quantum": -np.ones(4)}, "quantum must be 4 numbers"),
    "usable": (lambda r: {"usable": np.ones((3, 4), bool)}, "usable has shape"),
    "frames": (lambda r: {"frames": {"cam": [np.zeros((2, 2, 3), np.uint8)]}}, "cam has 1 frames for 600"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_fields_are_named_in_one_sentence(make, case):
    change, message = BAD[case]
    with pytest.raises(RecordingError, match=message) as caught:
        make(source="logs/sine_01.hdf5", **change(make()))
    assert str(caught.value).startswith("logs/sine_01.hdf5: ")
    assert "\n" not in str(caught.value) and ". " not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("step_01", "step"),
        ("multisine-3", "multisine"),
        ("step", "step"),
        ("2024", "motion"),
        ("a1_b__12", "a1_b"),
    ],
)
def test_kind_is_the_name_without_its_number(name, kind):
    assert default_kind(name) == kind


def numbered(make, *names):
    return Recordings(make(name=name) for name in names)


def test_split_deals_in_turn_within_each_kind(make):
    recordings = numbered(make, "sine_1", "step_1", "sine_2", "step_2", "step_3", "step_4")
    train, test = recordings.split()
    assert [r.name for r in train] == ["sine_1", "step_1", "step_3"]
    assert [r.name for r in test] == ["sine_2", "step_2", "step_4"]
    again = recordings.split()
    assert [[r.name for r in part] for part in again] == [[r.name for r in part] for part in (train, test)]


@pytest.mark.parametrize("share", [0.05, 0.25, 0.5, 0.95])
@pytest.mark.parametrize("count", [2, 3, 7])
def test_split_leaves_neither_part_empty_nor_shares_a_recording(make, share, count):
    recordings = numbered(make, *(f"{kind}_1" for kind in "abcdefg"[:count]))
    train, test = recordings.split(share)
    assert train and test
    assert sorted(r.name for r in (*train, *test)) == [r.name for r in recordings]


def test_split_needs_two_recordings_and_a_share(make):
    with pytest.raises(RecordingError, match="at least two"):
        numbered(make, "a").split()
    with pytest.raises(RecordingError, match="between 0 and 1"):
        numbered(make, "a", "b").split(1.0)


def test_recordings_behave_like_a_tuple(make):
    recordings = numbered(make, "sine_1", "step_1", "sine_2")
    assert len(recordings) == 3 and isinstance(recordings[0], Recording)
    assert [r.name for r in recordings[1:]] == ["step_1", "sine_2"] and isinstance(recordings[1:], Recordings)
    assert list(recordings.by_kind()) == ["sine", "step"] and len(recordings.by_kind()["sine"]) == 2
    assert [r.name for r in recordings.select(["sine_2", "sine_1"])] == ["sine_2", "sine_1"]
    assert repr(recordings) == "Recordings(3: 2 sine, 1 step)"
    with pytest.raises(RecordingError, match=r"'sine_9'.*sine_1, step_1"):
        recordings.select("sine_9")
