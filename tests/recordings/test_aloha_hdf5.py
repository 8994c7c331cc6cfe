import tracemalloc

import cv2
import h5py
import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import load_recordings, save_recording
from embodiedreamer_gym.recordings.aloha_hdf5 import ALOHA_JOINTS, read_aloha_hdf5


def aloha(path, rows=20, joints=14, gripper=0.5, **more):
    """A file as AgileX's logger writes it: no times, no names, zero effort."""
    rng = np.random.default_rng(0)
    qpos = rng.uniform(-2, 2, (rows, joints)).astype(np.float32)
    if joints == 14:
        qpos[:, [6, 13]] = gripper
    with h5py.File(path, "w") as file:
        file.attrs.update({"sim": False, "compress": False})
        data = {
            "action": qpos + 0.1,
            "base_action": np.zeros((rows, 2)),
            "observations/qpos": qpos,
            "observations/qvel": rng.standard_normal((rows, joints)).astype(np.float32),
            "observations/effort": np.zeros((rows, joints)),
        }
        for name, array in (data | more).items():
            if array is not None:
                file[name] = array
    return path


def test_a_published_file_is_read(tmp_path):
    path = aloha(tmp_path / "episode_3.hdf5")
    recording = read_aloha_hdf5(path, hz=30)
    assert recording.joints == ALOHA_JOINTS and len(ALOHA_JOINTS) == 14
    assert (recording.joints[6], recording.joints[7]) == ("left_gripper", "right_joint1")
    assert recording.units[5:7] == ("rad", "1") and recording.units[13] == "1"
    assert recording.effort is None and recording.velocity is not None
    assert recording.hz == pytest.approx(30) and recording.kind == "episode"
    assert recording.source == str(path) and recording.frames == {}


def test_a_gripper_beyond_1_is_not_normalised(tmp_path):
    assert read_aloha_hdf5(aloha(tmp_path / "a.hdf5", gripper=1.5), hz=30).units == ("rad",) * 14


@pytest.mark.parametrize("attribute", ["rate", "fps"])
def test_the_rate_may_stand_in_the_file(tmp_path, attribute):
    path = aloha(tmp_path / "a.hdf5")
    with h5py.File(path, "a") as file:
        file.attrs[attribute] = 25
    assert read_aloha_hdf5(path).hz == pytest.approx(25)
    assert read_aloha_hdf5(path, hz=50).hz == pytest.approx(50)


@pytest.mark.parametrize("names", [["a", "b", "c"], '["a", "b", "c"]'])
def test_names_and_times_are_taken_from_the_file(tmp_path, names):
    path = aloha(tmp_path / "a.hdf5", joints=3, timestamps=100 + np.arange(20) / 40, action=None)
    with h5py.File(path, "a") as file:
        file.attrs["joint_names"] = names
    recording = read_aloha_hdf5(path)
    assert recording.joints == ("a", "b", "c") and recording.hz == pytest.approx(40)
    assert recording.command is None


def test_other_sizes_get_numbered_joints_or_those_given(tmp_path):
    path = aloha(tmp_path / "a.hdf5", joints=3)
    assert read_aloha_hdf5(path, hz=30).joints == ("joint1", "joint2", "joint3")
    assert read_aloha_hdf5(path, hz=30, joints=("x", "y", "z")).joints == ("x", "y", "z")


@pytest.mark.parametrize("suffix", [".hdf5", ".h5"])
def test_a_recording_reads_back_equal(tmp_path, make, same, suffix):
    usable = np.ones((600, 4), bool)
    usable[10:20, 1] = False
    for recording in (
        make(usable=usable, command_hold="linear", kind="chirp", noise=np.full(4, 1 / 3), quantum=np.zeros(4)),
        make(effort_unit="N m", gain=[4.0, 1.0, 0.1, 1.0]),
        make(command=None, velocity=None, effort=None, time=1.7e5 + np.arange(600) / 50),
    ):
        path = save_recording(recording, tmp_path / f"{recording.name}{suffix}")
        same(recording, load_recordings(path)[0])


def buffers(images, form):
    """JPEG rows: padded to the longest, as one array, or of varying length."""
    coded = [cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1] for image in images]
    if form == "padded":
        width = max(map(len, coded)) + 5
        return np.stack([np.pad(row, (0, width - len(row))) for row in coded])
    rows = np.empty(len(coded), dtype=object)
    rows[:] = coded
    return rows


@pytest.mark.parametrize("form", ["raw", "padded", "varying"])
def test_frames_are_rgb_whatever_their_storage(tmp_path, form):
    images = np.zeros((20, 32, 40, 3), np.uint8)
    images[..., 0] = 10 * np.arange(20)[:, None, None]
    images[..., 2] = 30
    path = aloha(tmp_path / "a.hdf5")
    with h5py.File(path, "a") as file:
        if form == "varying":
            kind = h5py.vlen_dtype(np.uint8)
            file.create_dataset("observations/images/cam_high", data=buffers(images, form), dtype=kind)
        else:
            file["observations/images/cam_high"] = images if form == "raw" else buffers(images, form)
    frames = read_aloha_hdf5(path, hz=30).frames["cam_high"]
    assert len(frames) == 20
    for index in (0, 19, -1):
        assert frames[index].shape == (32, 40, 3) and frames[index].dtype == np.uint8
        assert np.abs(frames[index].astype(int) - images[index]).max() <= (0 if form == "raw" else 4)
    with pytest.raises(IndexError):
        frames[20]


def test_frames_travel_with_a_saved_recording(tmp_path, make, same):
    images = np.random.default_rng(0).integers(0, 255, (600, 6, 8, 3), np.uint8)
    recording = make(frames={"cam_high": list(images)})
    back = load_recordings(save_recording(recording, tmp_path / "sine_01.hdf5"))[0]
    same(recording, back)
    assert all(np.array_equal(back.frames["cam_high"][k], images[k]) for k in (0, 17, 599))
    again = load_recordings(save_recording(back, tmp_path / "sine_01.hdf5"))[0]  # onto the file being read
    assert np.array_equal(again.frames["cam_high"][599], images[599])


def test_images_are_read_in_constant_memory(tmp_path):
    path = aloha(tmp_path / "a.hdf5", rows=100)
    with h5py.File(path, "a") as file:
        for camera in ("cam_high", "cam_left_wrist", "cam_right_wrist"):
            shape = (100, 240, 320, 3)  # 23 MB a camera when loaded
            file.create_dataset(f"observations/images/{camera}", shape, np.uint8, chunks=(1, *shape[1:]))
    tracemalloc.start()
    try:
        recording = read_aloha_hdf5(path, hz=30)
        read = tracemalloc.get_traced_memory()[1]
        total = sum(int(frames[k].sum()) for frames in recording.frames.values() for k in range(100))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert total == 0 and read < 2e6 and peak < 5e6


def test_a_frame_that_is_no_image_is_said_so(tmp_path):
    path = aloha(tmp_path / "a.hdf5", **{"observations/images/cam": np.ones((20, 50), np.uint8)})
    frames = read_aloha_hdf5(path, hz=30).frames["cam"]
    with pytest.raises(RecordingError, match=r"frame 3 of /observations/images/cam is not a JPEG"):
        frames[3]
    path.unlink()
    with pytest.raises(RecordingError, match="there is no such file"):
        frames[3]


BAD = {
    "no qpos": ({"observations/qpos": None}, r"/observations/qpos is missing; the file has /action"),
    "shapes": ({"action": np.zeros((20, 7))}, r"/action has shape \(20, 7\)"),
    "velocity": ({"observations/qvel": np.zeros((19, 14))}, r"/observations/qvel has shape \(19, 14\)"),
    "times": ({"timestamps": np.arange(19.0)}, r"19 times \(float64\) for 20 rows"),
    "scalar time": ({"timestamps": 3.0}, r"1 times \(float64\) for 20 rows"),
    "backwards": ({"timestamps": -np.arange(20.0)}, "runs backwards at row 1"),
    "text": ({"action": np.full((20, 14), b"x")}, "/action is .* numbers of shape"),
    "flat": ({"observations/qpos": np.zeros(20)}, r"/observations/qpos is float64 of shape \(20,\)"),
    "group": ({"action": None, "action/inner": np.zeros(3)}, "/action is a group"),
    "nan": ({"observations/qpos": np.full((20, 14), np.nan)}, "left_joint1 is nan at row 0"),
    "grey images": (
        {"observations/images/cam": np.zeros((20, 4, 4), np.uint8)},
        "/observations/images/cam is",
    ),
    "few images": ({"observations/images/cam": np.zeros((7, 4, 4, 3), np.uint8)}, "cam has 7 frames for 20"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_named_in_one_sentence(tmp_path, case):
    more, message = BAD[case]
    with pytest.raises(RecordingError, match=message) as caught:
        read_aloha_hdf5(aloha(tmp_path / "bad.hdf5", **more), hz=30)
    assert "bad.hdf5: " in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_without_times_asks_for_the_rate(tmp_path):
    path = aloha(tmp_path / "a.hdf5")
    with pytest.raises(RecordingError, match="--hz HZ"):
        read_aloha_hdf5(path)
    with pytest.raises(RecordingError, match="must be above 0"):
        read_aloha_hdf5(path, hz=0)


def test_few_rows_and_wrong_names_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="at least 10 samples"):
        read_aloha_hdf5(aloha(tmp_path / "few.hdf5", rows=9), hz=30)
    with pytest.raises(RecordingError, match="at least 10 samples"):
        read_aloha_hdf5(aloha(tmp_path / "none.hdf5", rows=0), hz=30)
    with pytest.raises(RecordingError, match="2 joint names for 14 columns"):
        read_aloha_hdf5(aloha(tmp_path / "names.hdf5"), hz=30, joints=("a", "b"))
    path = aloha(tmp_path / "json.hdf5")
    with h5py.File(path, "a") as file:
        file.attrs["joint_names"] = "a, b"
    with pytest.raises(RecordingError, match="neither a list of strings nor JSON"):
        read_aloha_hdf5(path, hz=30)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.95])
def test_a_cut_file_is_refused(tmp_path, share):
    path = aloha(tmp_path / "cut.hdf5", rows=2000)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(RecordingError, match="damaged, cut short"):
        read_aloha_hdf5(path, hz=30)
