"""MCAP files and rosbag2 folders: topics and decoded messages, with size limits.

Messages are decoded with the definitions in this module, never with those in a file, which the library would turn into
code. A controller's state is read only up to its second point, because this part is the same in every ROS 2 release:
the desired point, then the actual point.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError, brief
from embodiedreamer_gym.io.files import check_regular
from embodiedreamer_gym.recordings.extras import load_extra
from embodiedreamer_gym.recordings.hdf5 import MAX_BYTES, MAX_CHUNK_BYTES

SUFFIXES = (".mcap", ".db3")
METADATA = "metadata.yaml"
MOST_METADATA = 10_000_000  # bytes
MOST_MESSAGE = 1_000_000  # bytes of a message of joints
JOINT_STATE, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
CONTROLLER, NUMBERS = "control_msgs/msg/JointTrajectoryControllerState", "std_msgs/msg/Float64MultiArray"
CONTROLLER_BEGINS = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint wanted
trajectory_msgs/JointTrajectoryPoint actual
"""
MAGIC = b"\x89MCAP0\r\n"
CHUNK, CHUNK_INDEX = 6, 8  # MCAP record types
ZSTD = b"\x28\xb5\x2f\xfd"


class Message(NamedTuple):
    """A message and its time of arrival, ns."""

    received: int
    data: Any


def is_rosbag(path: Path) -> bool:
    """Whether a path is an MCAP file, an SQLite file of rosbag2, or a folder of rosbag2."""
    return path.suffix in SUFFIXES if path.is_file() else (path / METADATA).is_file()


class Bag:
    """An open bag. topics: name -> type, for topics whose messages can be read."""

    def __init__(self, reader: Any, path: Path) -> None:
        self._reader, self._path = reader, path
        self.topics = {one.topic: one.msgtype for one in reader.connections if one.msgtype in _types().fielddefs}

    def messages(self, topic: str, most: int) -> Iterator[Message]:
        """Messages of a topic in the order of their arrival.

        Raises: RecordingError where a message cannot be decoded or is too large, and for more than `most` messages.
        """
        connections = [one for one in self._reader.connections if one.topic == topic]
        kind, types = self.topics[topic], _types()
        definition = types.get_msgdef(kind)
        for count, (_, received, raw) in enumerate(self._reader.messages(connections)):
            if count >= most or len(raw) > MOST_MESSAGE:
                raise RecordingError(f"{self._path}: {topic} has more messages, or larger ones, than a log of joints")
            if bytes(raw[:2]) not in (b"\0\0", b"\0\1"):
                raise RecordingError(f"{self._path}: message {count} of {topic} is not encoded as CDR")
            decode = definition.deserialize_cdr_le if raw[1] else definition.deserialize_cdr_be
            try:
                yield Message(int(received), decode(raw[4:], 0, definition.cls, types)[0])
            except (
                struct.error,
                ValueError,
                IndexError,
                OverflowError,
                load_extra("rosbags.serde").SerdeError,
            ) as error:
                raise RecordingError(f"{self._path}: message {count} of {topic} is damaged or not a {kind}") from error


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open an MCAP file or a rosbag2.

    Raises: RecordingError where it is damaged, compressed per file or message, or claims more than fits into memory;
    MissingExtraError without rosbags.
    """
    library = load_extra("rosbags.rosbag2")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for one in files:
        if one.suffix in SUFFIXES:
            check_regular(one, RecordingError)
            if not one.is_file():
                raise RecordingError(f"{one}: it is a folder, or points to nothing")
        if one.suffix == ".mcap":
            _check_mcap(one)
    if path.is_dir():
        _check_metadata(path / METADATA)
    try:
        with library.Reader(path) as reader:
            yield Bag(reader, path)
    except EmbodieDreamerError:
        raise
    except Exception as error:  # raised by ruamel, apsw, lz4, zstd, struct or rosbags
        text = " ".join(str(error).split())[:200]
        raise RecordingError(
            f"{path}: not a readable MCAP file or rosbag2 of ROS 2 ({type(error).__name__}: {text})"
        ) from error


@cache
def _types() -> Any:
    """Type store of the ROS 2 messages that are read."""
    typesys = load_extra("rosbags.typesys")
    whole = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    wanted = [JOINT_STATE, TRAJECTORY, NUMBERS, "trajectory_msgs/msg/JointTrajectoryPoint"]
    wanted += ["std_msgs/msg/Header", "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration",
               "std_msgs/msg/MultiArrayLayout", "std_msgs/msg/MultiArrayDimension"]  # fmt: skip
    types = typesys.get_typestore(typesys.Stores.EMPTY)
    types.register({name: whole.fielddefs[name] for name in wanted})
    types.register(typesys.get_types_from_msg(CONTROLLER_BEGINS, CONTROLLER))
    return types


def _check_metadata(path: Path) -> None:
    """Raises: RecordingError for a metadata.yaml that is too large, or compression that the library does not limit."""
    check_regular(path, RecordingError)
    if path.stat().st_size > MOST_METADATA:
        raise RecordingError(
            f"{path}: it is larger than {MOST_METADATA // 1_000_000} MB; this is not the metadata of a bag"
        )
    text = path.read_text(encoding="utf-8", errors="replace")
    if re.search(r"compression_mode['\"]?\s*:\s*['\"]?(file|message)", text, re.IGNORECASE):
        raise RecordingError(
            f"{path.parent}: rosbag2's own compression cannot be read, only that of MCAP; convert it with `ros2 bag convert`"
        )


def _check_mcap(path: Path) -> None:
    """Raises: RecordingError for an MCAP file with records longer than the file, or chunks too large for memory."""
    size, total = path.stat().st_size, 0
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path}: it does not begin as an MCAP file does")
        while file.tell() < size - len(MAGIC):
            head = file.read(9)
            length = int.from_bytes(head[1:], "little")
            start = file.tell()
            if len(head) < 9 or start + length > size:
                raise RecordingError(f"{path}: cut short, or damaged at byte {start - len(head)}; copy it again")
            if head[0] in (CHUNK, CHUNK_INDEX):
                claimed = max(_claims(file, head[0], length))
                total += claimed if head[0] == CHUNK else 0
                if claimed > MAX_CHUNK_BYTES or total > 8 * MAX_BYTES:
                    raise RecordingError(
                        f"{path}: it claims chunks of {claimed} bytes, {total} in all; this is not a log of joints"
                    )
            file.seek(start + length, os.SEEK_SET)


def _claims(file: BinaryIO, kind: int, length: int) -> Sequence[int]:
    """Decompressed sizes in bytes that a chunk, or its entry in the index, claims."""
    data = file.read(min(length, 4096 if kind == CHUNK else length))
    number = lambda at, width: int.from_bytes(data[at : at + width], "little")  # noqa: E731
    if kind == CHUNK_INDEX:
        return (number(len(data) - 8, 8), number(len(data) - 16, 8))
    at = 28 + 4 + number(28, 4) + 8  # after times, sizes, checksum and the compression's name
    if data[at : at + 4] != ZSTD:
        return (number(16, 8),)
    info = load_extra("rosbags.rosbag2.storage_mcap").zstd.get_frame_info(data[at:])
    return (number(16, 8), info.decompressed_size or 0)


def chosen_topic(topics: Sequence[str], given: str | None, option: str, what: str, path: Path) -> str:
    """The only topic, or the one that the user names.

    Raises: RecordingError where the named topic does not exist, or none is named and there is not exactly one.
    """
    listed = ", ".join(topics) or "none"
    if given is not None:
        if given not in topics:
            raise RecordingError(f"{path}: there is no topic {brief(given)} with {what}; there are {listed}")
        return given
    if len(topics) != 1:
        ask = f"several topics have {what}, {listed}; name one with {option}" if topics else f"no topic has {what}"
        raise RecordingError(f"{path}: {ask}")
    return topics[0]
