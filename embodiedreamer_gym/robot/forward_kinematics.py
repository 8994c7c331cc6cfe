"""Forward kinematics of a URDF's links over whole trajectories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yourdfpy
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.urdf import MOVABLE, read_urdf


def joints_from_root(robot: yourdfpy.Robot, root: str) -> list[yourdfpy.Joint]:
    """Joints, ordered so that parents come first."""
    below: dict[str, list[yourdfpy.Joint]] = {}
    for joint in robot.joints:
        below.setdefault(joint.parent, []).append(joint)
    links, order = [root], []
    for link in links:
        order += below.get(link, [])
        links += [joint.child for joint in below.get(link, [])]
    return order


def joint_values(joint: yourdfpy.Joint, values: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Values (T,) of a joint: its own, else those given by the joint it mimics, else None."""
    if joint.name in values:
        return values[joint.name]
    if joint.mimic is None or joint.mimic.joint not in values:
        return None
    gain = 1.0 if joint.mimic.multiplier is None else joint.mimic.multiplier
    return gain * values[joint.mimic.joint] + (joint.mimic.offset or 0.0)


def joint_poses(joint: yourdfpy.Joint, values: np.ndarray | None, rows: int) -> np.ndarray:
    """Poses (T, 4, 4) of a joint's child in its parent's frame at values (T,), rad or m; at zero without values."""
    motion = np.broadcast_to(np.eye(4), (rows, 4, 4)).copy()
    if values is not None and joint.type in MOVABLE:
        axis = np.asarray(joint.axis, float)
        steps = values[:, None] * (axis / np.linalg.norm(axis))
        if joint.type == "prismatic":
            motion[:, :3, 3] = steps
        else:
            motion[:, :3, :3] = Rotation.from_rotvec(steps).as_matrix()
    return motion if joint.origin is None else np.asarray(joint.origin, float) @ motion


class EndEffector:
    """Forward kinematics of one link of a URDF (given by path or text), in the root link's frame.

    joints: names of the movable joints that move the link.
    Raises: ModelError for a URDF that cannot be read, or without that link.
    """

    def __init__(self, urdf: str | Path, link: str) -> None:
        robot = read_urdf(urdf)
        links = [entry.name for entry in robot.links]
        self._source = "the URDF" if "<" in str(urdf) else str(urdf)
        if link not in links:
            raise ModelError(f"{self._source} has no link '{link}'; links: {', '.join(links)}.")
        self.link = link
        above, place = {joint.child: joint for joint in robot.joints}, link
        self._chain: list[yourdfpy.Joint] = []
        while place in above:
            self._chain.insert(0, above[place])
            place = above[place].parent
        self.joints = tuple(joint.name for joint in self._chain if joint.type in MOVABLE)

    def __repr__(self) -> str:
        return f"EndEffector({self.link!r}, {len(self.joints)} joints)"

    def pose(self, values: np.ndarray, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Positions (T, 3), m, and rotations (T, 3, 3) at joint values (T, n), rad or m as in the URDF.

        Joints that do not move the link are ignored; a mimic joint without own values follows its leader.

        Raises: ModelError when values and joints do not fit, or a joint that moves the link has no values.
        """
        values = np.asarray(values, float)
        if values.ndim != 2 or values.shape[1] != len(joints):
            raise ModelError(
                f"joint values have the shape {values.shape}, but these joints need (T, {len(joints)})"
                " with one row for each time."
            )
        given = dict(zip(joints, values.T, strict=True))
        pose = np.broadcast_to(np.eye(4), (len(values), 4, 4))
        for joint in self._chain:
            own = joint_values(joint, given)
            if own is None and joint.type in MOVABLE:
                raise ModelError(
                    f"joint '{joint.name}' of {self._source} moves '{self.link}' but has no values; "
                    f"given are {', '.join(given) or 'none'}."
                )
            pose = pose @ joint_poses(joint, own, len(values))
        return pose[:, :3, 3].copy(), pose[:, :3, :3].copy()
