import os

import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import files, load_recordings, save_recording


@pytest.fixture
def logs(tmp_path, make):
    """A folder with step_2.csv, step_10.hdf5 and a file that is no recording."""
    save_recording(make(name="step_10"), tmp_path / "logs" / "step_10.hdf5")
    save_recording(make(name="step_2"), tmp_path / "logs" / "step_2.csv")
    (tmp_path / "logs" / "notes.txt").write_text("hello")
    return tmp_path / "logs"


def names(recordings):
    return [recording.name for recording in recordings]


def test_files_folders_and_globs_are_read_in_natural_order(logs):
    assert names(load_recordings(logs)) == ["step_2", "step_10"]
    assert names(load_recordings(f"{logs}/step*")) == ["step_2", "step_10"]
    assert names(load_recordings(logs / "step_10.hdf5", logs / "step_2.csv")) == ["step_10", "step_2"]


def test_a_file_is_read_once(logs):
    assert names(load_recordings(logs / "step_10.hdf5", f"{logs}/*.hdf5", logs)) == ["step_10", "step_2"]


def test_a_name_with_brackets_is_a_file_before_a_glob(logs):
    (logs / "step_2.csv").rename(logs / "step[2].csv")
    assert names(load_recordings(logs / "step[2].csv")) == ["step[2]"]


def test_home_is_understood(logs, monkeypatch):
    monkeypatch.setenv("HOME", str(logs))
    assert names(load_recordings("~/*.csv")) == ["step_2"]


def test_joints_are_taken_and_command_hold_is_set(logs):
    recordings = load_recordings(logs, joints=["elbow", "base"], command_hold="linear")
    assert all(r.joints == ("elbow", "base") and r.command_hold == "linear" for r in recordings)


def test_gains_go_to_files_by_the_end_of_their_path(logs):
    gains = [r.gain.tolist() for r in load_recordings(logs, gains={"step*": 3, "logs/step_10.hdf5": 5, "other/*": 2})]
    assert gains == [[3.0] * 4, [5.0] * 4]
    with pytest.raises(RecordingError, match="gain must be one number above 0, or 4 of them"):
        load_recordings(logs, gains={"step_2.csv": -1})


@pytest.mark.parametrize(
    ("patterns", "given", "message"),
    [
        ((), {}, "no recording was named"),
        (("{}/*.bag",), {}, "matches no file"),
        (("{}/nothing.hdf5",), {}, "nothing.hdf5: there is no such file or folder"),
        (("{}/notes.txt",), {}, "the suffix '.txt' is not known; expected .hdf5"),
        (("{}/n*",), {}, "notes.txt: the suffix '.txt'"),
        (("{}/empty",), {}, "no recording in this folder"),
        (("{}",), {"joints": ["wrist"]}, "asked for wrist; it has the joints base"),
        (("{}",), {"command_hold": "spline"}, "linear, hold, unknown"),
    ],
)
def test_what_cannot_be_read_is_named_in_one_sentence(logs, patterns, given, message):
    (logs / "empty").mkdir()
    with pytest.raises(RecordingError, match=message) as caught:
        load_recordings(*(pattern.format(logs) for pattern in patterns), **given)
    assert "\n" not in str(caught.value)


def test_an_interrupted_write_leaves_the_old_file(tmp_path, make, monkeypatch):
    path = save_recording(make(), tmp_path / "a.csv")
    before = path.read_bytes()

    def stop(recording, target):
        with open(target, "w") as file:
            file.write("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "write_plain_csv", stop)
    with pytest.raises(RecordingError, match="cannot be written: No space left"):
        save_recording(make(), path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["a.csv"]


def test_an_unknown_suffix_is_refused_before_anything_is_made(tmp_path, make):
    with pytest.raises(RecordingError, match=r"cannot write the suffix '.bag'; use .hdf5"):
        save_recording(make(), tmp_path / "new" / "a.bag")
    assert os.listdir(tmp_path) == []
