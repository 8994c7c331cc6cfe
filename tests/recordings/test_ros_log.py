"""MCAP and rosbag2: topics, stamps, commands of four kinds, and files of strangers."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.errors import MissingExtraError, RecordingError
from embodiedreamer_gym.recordings import extras, load_recordings

pytest.importorskip("rosbags", reason="bags need rosbags: pip install 'embodiedreamer-gym[ros]'")
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CONTROLLER = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
"""
TYPES = get_typestore(Stores.ROS2_HUMBLE)
TYPES.register(get_types_from_msg(CONTROLLER, "control_msgs/msg/JointTrajectoryControllerState"))
START = 1_790_000_000_000_000_000  # ns
JOINTS = ("base", "shoulder", "elbow", "gripper")
Rows = Iterable[tuple[int, Any]]


def make_message(kind: str, **fields: Any) -> Any:
    return TYPES.types[kind](**fields)


def header(stamp: int) -> Any:
    time = make_message("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return make_message("std_msgs/msg/Header", stamp=time, frame_id="")


def point(position: Any = (), velocity: Any = (), after: float = 0.0) -> Any:
    duration = make_message("builtin_interfaces/msg/Duration", sec=int(after), nanosec=round(after % 1 * 1e9))
    return make_message(
        "trajectory_msgs/msg/JointTrajectoryPoint", positions=np.array(position, float), accelerations=np.empty(0),
        velocities=np.array(velocity, float), effort=np.empty(0), time_from_start=duration,
    )  # fmt: skip


def joint_state(
    stamp: int, position: Any, names: tuple[str, ...] = JOINTS, velocity: Any = (), effort: Any = ()
) -> Any:
    rows = {"position": position, "velocity": velocity, "effort": effort}
    return make_message("sensor_msgs/msg/JointState", header=header(stamp), name=list(names),
                        **{key: np.array(row, float) for key, row in rows.items()})  # fmt: skip


def controller_state(stamp: int, wanted: Any, actual: Any) -> Any:
    return make_message("control_msgs/msg/JointTrajectoryControllerState", header=header(stamp), joint_names=list(JOINTS),
                        reference=point(wanted), feedback=point(actual, actual), error=point(), output=point(wanted))  # fmt: skip


def trajectory(stamp: int, *points: Any) -> Any:
    return make_message(
        "trajectory_msgs/msg/JointTrajectory", header=header(stamp), joint_names=list(JOINTS), points=list(points)
    )


def numbers(values: Any) -> Any:
    layout = make_message("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return make_message("std_msgs/msg/Float64MultiArray", layout=layout, data=np.array(values, float))


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a bag of topics: name -> rows of arrival and message."""

    def build(topics: dict[str, Rows], name: str = "bag", mcap: bool = True, compressed: Any = None) -> Path:
        writer = Writer(
            tmp_path / name, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        )
        if compressed is not None:
            writer.set_compression(compressed, CompressionFormat.ZSTD)
        with writer:
            for topic, rows in topics.items():
                connection = None
                for arrival, data in rows:
                    kind = data.__msgtype__
                    connection = connection or writer.add_connection(topic, kind, typestore=TYPES)
                    writer.write(connection, arrival, TYPES.serialize_cdr(data, kind))
        return tmp_path / name

    return build


@pytest.fixture
def log(make):
    """Times in whole ms, from 0."""
    return make()


def stamps(log) -> list[int]:
    return [START + round(t * 1e9) for t in log.time]


def states(log, late: int = 3_000_000, stamped: bool = True, **more: Any) -> list[tuple[int, Any]]:
    return [
        (t + late, joint_state(t if stamped else 0, x, **more)) for t, x in zip(stamps(log), log.position, strict=True)
    ]


@pytest.mark.parametrize("mcap", [True, False])
@pytest.mark.parametrize("compressed", [None, CompressionMode.STORAGE])
def test_states_and_commands_by_their_stamps(write, log, mcap: bool, compressed: Any) -> None:
    """Commands are written in another order of joints; arrival is 3 ms late."""
    names = tuple(reversed(JOINTS))
    commands = [(t, joint_state(t, u[::-1], names)) for t, u in zip(stamps(log), log.command, strict=True)]
    rows = [(t + 3_000_000, joint_state(t, x, JOINTS, v, e)) for t, x, v, e in
            zip(stamps(log), log.position, log.velocity, log.effort, strict=True)]  # fmt: skip
    topics = {"/joint_states": rows, "/joint_commands": commands}
    folder = write(topics, mcap=mcap, compressed=compressed if mcap else None)
    for path in (folder, next(one for one in folder.iterdir() if one.suffix in (".mcap", ".db3"))):
        (one,) = load_recordings(path)
        assert one.joints == JOINTS and one.notes == () and not one.nominal_time
        for name in ("time", "position", "velocity", "effort", "command"):
            assert np.array_equal(getattr(one, name), getattr(log, name)), name
    assert [one.name for one in load_recordings(folder.parent)] == ["bag"]


def test_a_controllers_state_holds_both(write, log) -> None:
    rows = [(t, controller_state(t, u, x)) for t, u, x in zip(stamps(log), log.command, log.position, strict=True)]
    (one,) = load_recordings(write({"/arm/state": rows}), joints=["elbow", "base"])
    assert np.array_equal(one.position, log.position[:, [2, 0]]) and np.array_equal(one.command, log.command[:, [2, 0]])
    assert one.velocity is not None and one.notes == (
        "shoulder, gripper of the log are not joints of the model and were left out",
    )


def test_numbers_have_no_names_and_no_stamps(write, log) -> None:
    commands = [(t + 1, numbers(u)) for t, u in zip(stamps(log)[5:], log.command[5:], strict=True)]
    path = write({"/joint_states": states(log), "/forward/commands": commands})
    (one,) = load_recordings(path, joints=JOINTS)
    assert len(one.time) == len(log.time) - 6 and np.array_equal(one.command, log.command[5:-1])
    assert [note.split(";")[0] for note in one.notes] == [
        "the messages of /forward/commands carry no stamps", "6 states before the first command were left out",
        "the commands of /forward/commands carry no names",
    ]  # fmt: skip
    with pytest.raises(RecordingError, match="4 numbers without names for the joints elbow"):
        load_recordings(path, joints=["elbow"])


def test_clocks_that_differ_leave_the_times_of_arrival(write, log) -> None:
    commands = [(t + 5 * 10**9, numbers(u)) for t, u in zip(stamps(log), log.command, strict=True)]
    (one,) = load_recordings(write({"/joint_states": states(log, 5 * 10**9), "/c": commands}), joints=JOINTS)
    assert np.array_equal(one.command, log.command) and "a different clock" in " ".join(one.notes)
    (bare,) = load_recordings(write({"/joint_states": states(log, stamped=False)}, "bare"))
    assert np.array_equal(bare.time, log.time) and "carry no stamps" in bare.notes[0] and bare.command is None


def test_a_trajectory_is_followed_until_the_next_one(write, log) -> None:
    """From where the arm stands to 1 in a second; after half of it, back to 0; then a jump."""
    still = log.with_(position=np.zeros_like(log.position))
    first = trajectory(START + 10**9, point([1.0] * 4, after=1.0))
    second = trajectory(START + 1_500_000_000, point([0.0] * 4, after=0.5), point([0.25] * 4, after=1.0))
    third = trajectory(START + 4 * 10**9, point([0.75] * 4))
    commands = [
        (START, trajectory(START, point([0.0] * 4, after=0.1))),
        (START + 1, first),
        (START + 2, second),
        (START + 3, third),
    ]
    (one,) = load_recordings(write({"/joint_states": states(still), "/arm/joint_trajectory": commands}))
    t = one.time
    wanted = np.interp(t, [0, 1, 1.5, 2, 2.5, 4, 4.000000001], [0, 0, 0.5, 0, 0.25, 0.25, 0.75])
    assert np.allclose(one.command, wanted[:, None], atol=1e-6) and one.command_hold == "linear"


def test_a_topic_is_asked_for_and_given(write, log) -> None:
    one, other = (
        [(t, joint_state(t, x)) for t, x in zip(stamps(log), y, strict=True)] for y in (log.command, log.position)
    )
    path = write({"/left/state": other, "/left/command": one, "/right/command": one})
    with pytest.raises(RecordingError, match=r"several topics have joint states, .*name one with --state-topic"):
        load_recordings(path)
    with pytest.raises(RecordingError, match=r"/left/command, /right/command; name one with --command-topic"):
        load_recordings(path, state_topic="/left/state")
    (read,) = load_recordings(path, state_topic="/left/state", command_topic="/right/command")
    assert np.array_equal(read.command, log.command) and np.array_equal(read.position, log.position)
    with pytest.raises(RecordingError, match="no topic '/x' with joint states; there are /left/state"):
        load_recordings(path, state_topic="/x")


def test_what_does_not_fit_is_one_sentence(write, log, tmp_path: Path) -> None:
    cases = {
        "no topic has joint states": {"/c": [(START, numbers([1.0]))]},
        "the number of positions differs from the number of names": {
            "/joint_states": [(t, joint_state(t, [0.0])) for t in stamps(log)]
        },
        "do not overlap in time": {
            "/joint_states": states(log),
            "/u": [(START + 10**12, joint_state(START + 10**12, [0.0] * 4))],
        },
        "no points": {"/joint_states": states(log), "/u": [(START, trajectory(START))]},
    }
    for k, (message, topics) in enumerate(cases.items()):
        with pytest.raises(RecordingError, match=message) as caught:
            load_recordings(write(topics, f"bag{k}"))
        assert f"bag{k}" in str(caught.value) and "\n" not in str(caught.value)
    for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
        with pytest.raises(RecordingError, match="ros2 bag convert"):
            load_recordings(write({"/joint_states": states(log)}, mode.name, False, mode))
    (tmp_path / "a.mcap").write_bytes(b"hello")
    with pytest.raises(RecordingError, match=r"a\.mcap: it does not begin"):
        load_recordings(tmp_path / "a.mcap")


def test_sizes_are_checked_before_anything_is_read(write, log) -> None:
    (path,) = write({"/joint_states": states(log)}, compressed=CompressionMode.STORAGE).glob("*.mcap")
    data = path.read_bytes()
    chunk = data.index(b"\x06", 8 + 9 + struct.unpack("<Q", data[9:17])[0])
    for at, value, message in (
        (chunk + 1, 2**60, "cut short, or damaged"), (chunk + 25, 2**40, "claims chunks of 1099511627776 bytes"),
    ):  # fmt: skip
        path.write_bytes(data[:at] + struct.pack("<Q", value) + data[at + 8 :])
        with pytest.raises(RecordingError, match=message):
            load_recordings(path)
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(RecordingError, match="cut short"):
        load_recordings(path)


def test_the_definitions_of_a_file_are_not_used(write, log) -> None:
    """They would become code: a file's own definition of a message is never parsed."""
    folder = write({"/joint_states": states(log)})
    (path,) = folder.glob("*.mcap")
    data = path.read_bytes()
    assert data.count(b"float64[] position") == 2
    path.write_bytes(data.replace(b"float64[] position", b"import os; float64"))
    (one,) = load_recordings(path)
    assert np.array_equal(one.position, log.position)


def test_without_the_extra(write, log, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write({"/joint_states": states(log)})

    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(extras.importlib, "import_module", absent)
    with pytest.raises(
        MissingExtraError, match=r"bag[s2]* files need rosbags, .*pip install 'embodiedreamer-gym\[ros\]'"
    ):
        load_recordings(path)
    shutil.rmtree(path)
