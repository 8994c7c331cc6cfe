"""The parts of a model that every format needs: the joints' numbers with the effects, and the changed bodies."""

from __future__ import annotations

import copy
import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from embodiedreamer_gym.effects import Effect, Mechanics, MechanicsChange, SignalLaw
from embodiedreamer_gym.engines.export.effects import Entry
from embodiedreamer_gym.engines.export.joints import Joints, plain_joints, scales
from embodiedreamer_gym.engines.export.report import Line
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.urdf import read_xml
from embodiedreamer_gym.simulation.drive_setup import changed_mechanics, parameter_values

MASSES = ("mass", "first_moment", "inertia")
OF_THE_LOG = ("effort", "clock")  # stages of laws that change only the log


@dataclass
class Parts:
    """A model as far as a format can express it.

    joints: in the units of the URDF's joints; mechanics: with the effects; bodies, gain, zero (n,): see `scales`.
    """

    joints: Joints
    mechanics: Mechanics
    bodies: np.ndarray
    gain: np.ndarray
    zero: np.ndarray
    written: list[Line]
    lost: list[Line]


def parts_of(model: RobotModel, table: Mapping[str, Entry], places: Mapping[str, str], library: Any = None) -> Parts:
    """A model's parts, with the effects in a format's table and the changes of mechanics that have places in it.

    library: module whose attributes decide which entries can be used.
    """
    joints, written, lost = plain_joints(model), [], []
    if model.gravity_compensation.any():
        lost.append(
            Line(
                "gravity_compensation",
                "the servo compensates for the weight of the links, which the format cannot express",
            )
        )
    for effect in model.effects:
        place, loss = _apply(effect, model, joints, table, places, library)
        if place:
            written.append(Line(effect.name, place))
        if loss:
            lost.append(Line(effect.name, loss))
    values = [(e, parameter_values(e, model, {}, 1)) for e in model.effects]
    mechanics = changed_mechanics(model, model.rotor_inertia[None].copy(), values)
    joints.rotor_inertia = np.broadcast_to(mechanics.rotor_inertia, (1, model.n))[0].copy()
    bodies, gain, zero = scales(model)
    return Parts(joints.of_urdf(gain, zero), mechanics, bodies, gain, zero, written, lost)


def _apply(
    effect: Effect,
    model: RobotModel,
    joints: Joints,
    table: Mapping[str, Entry],
    places: Mapping[str, str],
    library: Any,
) -> tuple[str, str]:
    """Apply an effect to the joints' numbers; returns its place in the file, and what is lost."""
    if isinstance(effect, SignalLaw) and effect.stage in OF_THE_LOG:
        return "", "affects only the log, not the robot: nothing is lost"
    if isinstance(effect, MechanicsChange):
        fields = changed_fields(effect, model)
        kept = dict.fromkeys(places[name] for name in fields if name in places)
        return "; ".join(kept), effect.symptom if any(name not in places for name in fields) else ""
    entry = table.get(effect.name)
    if entry is None:
        return "", effect.symptom
    if entry.otherwise and not _has(library, entry.needs):
        entry = entry.otherwise
    if not _has(library, entry.needs):
        return (
            "",
            f"{effect.symptom} (MuJoCo {library.__version__} has no {entry.needs.rpartition('.')[2]}; a newer one has)",
        )
    values = {name: array[0] for name, array in parameter_values(effect, model, {}, 1).items()}
    loss = entry.write(joints, SimpleNamespace(**values))
    return entry.place, loss or ""


def _has(library: Any, name: str) -> bool:
    try:
        return not name or bool(operator.attrgetter(name)(library))
    except AttributeError:
        return False


def changed_fields(effect: MechanicsChange, model: RobotModel) -> list[str]:
    """Names of the fields of the mechanics that an effect changes."""
    values = parameter_values(effect, model, {}, 1)
    plain, changed = (changed_mechanics(model, model.rotor_inertia[None].copy(), v) for v in ([], [(effect, values)]))
    return [
        name
        for name, value in vars(changed).items()
        if not np.allclose(value, getattr(plain, name), rtol=1e-12, atol=0)
    ]


def changed_urdf(model: RobotModel, mechanics: Mechanics) -> ElementTree.Element:
    """The model's URDF with the masses of changed mechanics; joints that the model does not drive are fixed.

    The inertial of a changed body is in the link that its joint moves; the links fixed to that have none.
    """
    root, tree, nominal = copy.deepcopy(read_xml(model.urdf)), model.tree, model.nominal_mechanics
    links = {str(link.get("name")): link for link in root.iter("link")}
    below: dict[str, list[str]] = {}
    moved = {}
    for joint in root.iter("joint"):
        if joint.find("child") is None:
            continue  # of a transmission
        child = str(_child(joint, "child").get("link"))
        if joint.get("name") in tree.joint_names:
            moved[str(joint.get("name"))] = child
        else:
            joint.set("type", "fixed")
            below.setdefault(str(_child(joint, "parent").get("link")), []).append(child)
    for i, name in enumerate(tree.joint_names):
        new, old = ([getattr(m, field)[0, i] for field in MASSES] for m in (mechanics, nominal))
        if all(np.array_equal(a, b) for a, b in zip(new, old, strict=True)):
            continue
        for link in _fixed_to(moved[name], below):
            for inertial in links[link].findall("inertial"):
                links[link].remove(inertial)
        links[moved[name]].append(_inertial(*new))
    return root


def _child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    found = element.find(tag)
    if found is None:
        raise ModelError(f"the URDF's joint {element.get('name')} has no {tag}.")
    return found


def _fixed_to(link: str, below: Mapping[str, list[str]]) -> Iterator[str]:
    yield link
    for child in below.get(link, []):
        yield from _fixed_to(child, below)


def _inertial(mass: float, moment: np.ndarray, inertia: np.ndarray) -> ElementTree.Element:
    """The inertial of a mass, kg, with first moment (3,), kg m, and inertia (3, 3) about the frame's origin, kg m^2."""
    centre = moment / mass
    about = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    element = ElementTree.Element("inertial")
    ElementTree.SubElement(element, "origin", xyz=" ".join(map(repr, centre.tolist())), rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=repr(float(mass)))
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ElementTree.SubElement(element, "inertia", {name: repr(float(about[at])) for name, at in names.items()})
    return element


def write_xml(root: ElementTree.Element, comment: str, path: Path) -> None:
    """Write XML with a comment at the beginning, atomically. Raises: ModelError when it cannot be written."""
    root.insert(0, ElementTree.Comment(comment))
    ElementTree.indent(root)
    with atomic_file(path, ModelError) as part:
        ElementTree.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)
