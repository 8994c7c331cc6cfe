"""Poses and contacts of bodies in a MuJoCo world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from embodiedreamer_gym.engines.engine import Engine
from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.table import TABLE
from embodiedreamer_gym.geometry.pose import Pose

XYZW, WXYZ = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])  # quaternions: w is first in MuJoCo, last in this package


class WorldState:
    """Reads poses, speeds and contacts by the names of bodies, and places props.

    model, data: MuJoCo's.
    """

    def __init__(self, model: Any, data: Any) -> None:
        self.model, self.data = model, data
        self.names = [model.body(i).name for i in range(model.nbody)]
        self._ids = {name: i for i, name in enumerate(self.names)}
        self._places, self._quaternions, self._rotations = data.xpos, data.xquat, data.xmat.reshape(-1, 3, 3)
        self._centres, self._velocities, self._body_of_geom = data.xipos, data.qvel, model.geom_bodyid
        self._first = model.body_dofadr.tolist()  # index of a body's velocity

    def link_of(self, joint: str) -> str:
        """Name of the link that a joint moves."""
        return self.names[int(self.model.joint(joint).bodyid[0])]

    def place(self, prop: Prop, pose: Pose) -> None:
        """Place a prop at a pose of its frame; its velocity is not changed."""
        where = np.concatenate([pose.position, pose.quaternion[WXYZ]])
        if prop.fixed:
            body = self._ids[prop.name]
            self.model.body_pos[body], self.model.body_quat[body] = where[:3], where[3:]
        else:
            self.data.joint(prop.name).qpos = where

    def pose(self, name: str) -> Pose:
        """Pose of a body's frame."""
        body = self._ids[name]
        return Pose(self._places[body].copy(), self._quaternions[body].take(XYZW))

    def rotation(self, name: str) -> np.ndarray:
        """Rotation matrix (3, 3) of a body's frame."""
        return self._rotations[self._ids[name]]

    def speed(self, prop: str) -> float:
        """Speed of a loose prop's centre of mass, m/s."""
        body, first = self._ids[prop], self._first[self._ids[prop]]
        x, y, z = (self._rotations[body] @ self._velocities[first + 3 : first + 6]).tolist()
        a, b, c = (self._centres[body] - self._places[body]).tolist()
        u, v, w = self._velocities[first : first + 3].tolist()
        return math.hypot(u + (y * c - z * b), v + (z * a - x * c), w + (x * b - y * a))

    def touching(self, name: str) -> set[str]:
        """Names of the bodies that a body touches."""
        body = self._ids[name]
        pairs = self._body_of_geom[self.data.contact.geom].tolist()
        return {self.names[b if a == body else a] for a, b in pairs if body in (a, b)}


class MujocoWorld(Engine):
    """An engine with a MuJoCo world: poses, speeds and contacts.

    state: of the world.
    link_names: of the robot, in the order of MuJoCo's bodies.
    """

    def take_over(self, model: Any, data: Any) -> None:
        """Use this MuJoCo model and data from now on."""
        props = [prop.name for prop in self.settings.props]
        self.state = WorldState(model, data)
        self.link_names = tuple(name for name in self.state.names if name not in ("world", TABLE.name, *props))
        self.part_names = (*self.link_names, *props)

    def pose(self, prop: str) -> Pose:
        """Pose of a prop."""
        return self.state.pose(prop)

    def link_pose(self, link: str) -> Pose:
        """Pose of the frame of a robot's link."""
        return self.state.pose(link)

    def links(self) -> Sequence[str]:
        """Names of the robot's links."""
        return self.link_names

    def speed(self, prop: str) -> float:
        """Speed of a prop's centre of mass, m/s."""
        return self.state.speed(prop)

    def touching(self, prop: str) -> set[str]:
        """Names of the links, of the props and of "table" that a prop touches."""
        return self.state.touching(prop)
