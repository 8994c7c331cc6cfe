"""Logs written as MCAP by the library mcap and as rosbag2 by the library rosbags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from embodiedreamer_gym.recordings import Recording

START = 1_790_000_000_000_000_000  # ns since 1970
KIND = "sensor_msgs/msg/JointState"
TOPICS = ("/joint_states", "/joint_commands")


def _messages(log: Recording) -> Iterator[tuple[str, int, bytes]]:
    """Topic, stamp (ns) and encoded message of each state and command."""
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds = types.types
    for k, stamp in enumerate((START + np.round(log.time * 1e9).astype(np.int64)).tolist()):
        time = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = kinds["std_msgs/msg/Header"](stamp=time, frame_id="")
        rows: list[dict[str, Any]] = [
            {name: np.empty(0) if (x := getattr(log, name)) is None else np.ascontiguousarray(x[k]) for name in ("position", "velocity", "effort")},
            {"position": None if log.command is None else np.ascontiguousarray(log.command[k]), "velocity": np.empty(0), "effort": np.empty(0)},
        ]  # fmt: skip
        for topic, row in zip(TOPICS, rows, strict=True):
            if row["position"] is not None:
                message = kinds[KIND](header=header, name=list(log.joints), **row)
                yield topic, stamp, bytes(types.serialize_cdr(message, KIND))


def write_rosbag2(log: Recording, folder: Path, mcap: bool = False) -> Path:
    """Write a folder of rosbag2, in SQLite or MCAP."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        types = get_typestore(Stores.ROS2_HUMBLE)
        topics = {topic: writer.add_connection(topic, KIND, typestore=types) for topic in TOPICS}
        for topic, stamp, data in _messages(log):
            writer.write(topics[topic], stamp, data)
    return folder


def write_mcap(log: Recording, path: Path) -> Path:
    """Write an MCAP file with the library mcap, in its default compression."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    definition, _ = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(KIND, ros_version=2)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema(KIND, "ros2msg", definition.encode())
        topics = {topic: writer.register_channel(topic, "cdr", schema) for topic in TOPICS}
        for topic, stamp, data in _messages(log):
            writer.add_message(topics[topic], stamp, data, stamp)
        writer.finish()
    return path
