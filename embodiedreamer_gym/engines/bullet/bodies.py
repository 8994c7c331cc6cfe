"""A robot model as bodies for PyBullet: one URDF for each arm, with the rotors' inertia added to its links.

One body per arm is a fifth faster than one body with two arms, and arms in different bodies collide. In free motion,
the torque of each step compensates for any inertia of the bodies. In contact, a link must resist as its geared rotor
does; otherwise a gripper would close on a cup with a sixth of its force. PyBullet does not accept inertia about a
single axis (it violates the triangle inequality), so a rotor adds to all three.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from embodiedreamer_gym.effects import Mechanics
from embodiedreamer_gym.engines.plant import rotor_shares
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.urdf import read_xml, resolve_meshes

FIXED = "fixed"


@dataclass(frozen=True)
class ArmBody:
    """One body for PyBullet: its URDF, and the links without a mass in it (PyBullet would set 1 kg)."""

    urdf: str
    weightless: frozenset[str]


def arm_bodies(model: RobotModel) -> tuple[ArmBody, ...]:
    """The robot cut into one URDF for each arm, where the arms leave its static part; meshes have absolute paths."""
    root = read_xml(model.urdf)
    resolve_meshes(root, model.urdf)
    return tuple(ArmBody(_write(part), _weightless(part)) for part in _cut(root))


def bullet_mechanics(model: RobotModel) -> Mechanics:
    """Masses and inertias of these bodies: the URDF's, plus each rotor's share on the link that it moves."""
    tree, rotor = model.tree, rotor_shares(model)
    mechanics = model.nominal_mechanics
    mass, moment, inertia = mechanics.mass.copy(), mechanics.first_moment.copy(), mechanics.inertia.copy()
    for b, share in enumerate(rotor):
        if tree.prismatic[b]:
            centre = tree.first_moment[b] / tree.mass[b]
            mass[0, b] += share
            moment[0, b] += share * centre
            inertia[0, b] += share * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        else:
            inertia[0, b] += share * np.eye(3)
    return replace(mechanics, mass=mass, first_moment=moment, inertia=inertia)


def _cut(root: Element) -> Iterator[Element]:
    """One copy of the robot for each branch of moving links; a static link's shapes stay with the branch on it."""
    joints = root.findall("joint")
    children: dict[str, list[Element]] = {}
    for joint in joints:
        children.setdefault(_end(joint, "parent"), []).append(joint)
    above = {_end(j, "child"): j for j in joints}
    static = {str(link.get("name")) for link in root.findall("link")} - set(above)
    branches: list[set[str]] = []
    owners: dict[str, list[int]] = {}
    waiting = sorted(static)
    while waiting:
        link = waiting.pop(0)
        for joint in children.get(link, []):
            if joint.get("type") == FIXED:
                static.add(_end(joint, "child"))
                waiting.append(_end(joint, "child"))
            else:
                branches.append(_below(_end(joint, "child"), children))
                foot: str | None = link
                while foot is not None:
                    owners.setdefault(foot, []).append(len(branches) - 1)
                    foot = _end(above[foot], "parent") if foot in above else None
    for number, branch in enumerate(branches):
        part = copy.deepcopy(root)
        for joint in part.findall("joint"):
            if _end(joint, "child") not in branch | static:
                part.remove(joint)
        for link in part.findall("link"):
            name = str(link.get("name"))
            if name not in branch | static:
                part.remove(link)
            elif name in static and owners.get(name, [0])[0] != number:
                for shape in (*link.findall("visual"), *link.findall("collision")):
                    link.remove(shape)
        yield part


def _below(link: str, children: dict[str, list[Element]]) -> set[str]:
    return {link}.union(*(_below(_end(joint, "child"), children) for joint in children.get(link, [])))


def _weightless(root: Element) -> frozenset[str]:
    return frozenset(str(link.get("name")) for link in root.iter("link") if link.find("inertial/mass") is None)


def _end(joint: Element, which: str) -> str:
    end = joint.find(which)
    return "" if end is None else str(end.get("link"))


def _write(root: Element) -> str:
    return ElementTree.tostring(root, encoding="unicode")
