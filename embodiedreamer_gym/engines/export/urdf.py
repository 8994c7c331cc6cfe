"""A calibrated model as a URDF: masses, damping, dry friction and limits; controllers have no place in one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from embodiedreamer_gym.engines.export.effects import URDF, URDF_BODIES
from embodiedreamer_gym.engines.export.parts import changed_urdf, copy_meshes, parts_of, write_xml
from embodiedreamer_gym.engines.export.report import Export, Line
from embodiedreamer_gym.robot import RobotModel


def write_urdf(model: RobotModel, path: Path) -> Export:
    """Write a model as a URDF, its meshes into FILE_meshes beside it.

    Raises: ModelError when a file cannot be read or written.
    """
    parts = parts_of(model, URDF, URDF_BODIES)
    root, joints = changed_urdf(model, parts.mechanics), parts.joints
    by_name = {joint.get("name"): joint for joint in root.iter("joint")}
    for i, name in enumerate(model.joints):
        damping, friction = joints.viscous_friction[i], joints.dry_friction[i]
        _set(by_name[name], "dynamics", damping=damping, friction=friction)
        limits = {"effort": joints.limit[i], "velocity": joints.speed[i]}
        _set(by_name[name], "limit", **{key: value for key, value in limits.items() if np.isfinite(value)})
    notes = meshes_of(root, model, path)
    written = (Line("viscous_friction", "dynamics: damping"), *parts.written)
    controller = (
        Line("servo", "a controller's gains are no part of a URDF; stiffness, N m/rad: "
             f"{_by_joint(model, joints.stiffness)}; damping, N m s/rad: {_by_joint(model, joints.damping)}"),
        Line("rotor_inertia", f"links alone have an inertia; at the joint, kg m^2: {_by_joint(model, joints.rotor_inertia)}"),
    )  # fmt: skip
    export = Export(model.name, "urdf", path, written, (*controller, *parts.lost), (*notes, *unit_notes(model)))
    write_xml(root, export.comment, path)
    return export


def _set(joint: ElementTree.Element, tag: str, **values: float) -> None:
    """Set attributes of a joint's element, which is made where it is missing and there is something to say."""
    element = joint.find(tag)
    if element is None and values:
        element = ElementTree.SubElement(joint, tag)
    if element is not None:
        element.attrib.update({key: repr(float(value)) for key, value in values.items()})


def _by_joint(model: RobotModel, values: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.6g}" for name, value in zip(model.joints, values, strict=True))


def unit_notes(model: RobotModel) -> list[str]:
    """What a user must know of joints that are recorded in another unit than the file's, or are not driven."""
    return [f"{name} is recorded as 0 to 1; here it is {low:g} to {high:g} (rad or m), commands too."
            for name, (low, high) in model.normalised.items()]  # fmt: skip


def meshes_of(root: ElementTree.Element, model: RobotModel, path: Path, readable: tuple[str, ...] = ()) -> list[str]:
    """Copy a URDF's meshes beside a file and name them there; what there is to say of it.

    readable: endings of the formats that the file's readers take; "": all. Others, and missing ones, stay as they are.
    """
    elements: dict[str, list[ElementTree.Element]] = {}
    for mesh in root.iter("mesh"):
        elements.setdefault(str(mesh.get("filename")), []).append(mesh)
    found = {name: (model.urdf.parent / name).resolve() for name in elements}
    there: Mapping[str, Path] = {
        name: one for name, one in found.items() if one.is_file() and (not readable or one.suffix.lower() in readable)
    }
    for name, copied in copy_meshes(there, path).items():
        for mesh in elements[name]:
            mesh.set("filename", copied)
    notes = [f"Meshes are copied into {path.stem}_meshes beside this file; keep both together."] if there else []
    return [
        *notes,
        *(f"The mesh {name} is missing, or of another format; it is left out." for name in found if name not in there),
    ]
