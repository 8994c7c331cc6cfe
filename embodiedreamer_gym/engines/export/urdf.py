"""Writes a calibrated model as a URDF: masses, damping, dry friction and limits; a URDF cannot contain controllers."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from embodiedreamer_gym.engines.export.effects import URDF, URDF_BODIES
from embodiedreamer_gym.engines.export.meshes import copy_meshes, mesh_notes
from embodiedreamer_gym.engines.export.parts import changed_urdf, parts_of, write_xml
from embodiedreamer_gym.engines.export.report import Export, Line, joint_notes
from embodiedreamer_gym.robot import RobotModel


def write_urdf(model: RobotModel, path: Path) -> Export:
    """Write a model as a URDF, and its meshes into the folder FILE_meshes beside it.

    Raises: ModelError when a file cannot be read or written.
    """
    parts = parts_of(model, URDF, URDF_BODIES)
    root, joints = changed_urdf(model, parts.mechanics), parts.joints
    by_name = {joint.get("name"): joint for joint in root.iter("joint")}
    for i, name in enumerate(model.joints):
        damping, friction = joints.viscous_friction[i], joints.dry_friction[i]
        _set(by_name[name], "dynamics", damping=damping, friction=friction)
        limits = {"effort": joints.limit[i], "velocity": min(joints.forward[i], joints.backward[i])}
        _set(by_name[name], "limit", **{key: value for key, value in limits.items() if np.isfinite(value)})
    meshes = [mesh for mesh in root.iter("mesh") if mesh.get("filename")]
    copied = copy_meshes([str(mesh.get("filename")) for mesh in meshes], model.urdf.parent, path)
    for mesh in meshes:
        mesh.set("filename", copied.get(str(mesh.get("filename")), str(mesh.get("filename"))))
    notes = (*mesh_notes(copied, (), path), *joint_notes(model))
    written = (Line("viscous friction", "dynamics: damping"), *parts.written)
    controller = (
        Line("servo", "a controller's gains are not part of a URDF; stiffness, N m/rad: "
             f"{_by_joint(model, joints.stiffness)}; damping, N m s/rad: {_by_joint(model, joints.damping)}"),
        Line("rotor inertia", f"only links have an inertia; at the joint, kg m^2: {_by_joint(model, joints.rotor_inertia)}"),
    )  # fmt: skip
    export = Export(model.name, "urdf", path, written, (*controller, *parts.lost), notes)
    write_xml(root, export.comment, path)
    return export


def _set(joint: ElementTree.Element, tag: str, **values: float) -> None:
    """Set attributes of a joint's element; a missing element is created if there are any."""
    element = joint.find(tag)
    if element is None and values:
        element = ElementTree.SubElement(joint, tag)
    if element is not None:
        element.attrib.update({key: repr(float(value)) for key, value in values.items()})


def _by_joint(model: RobotModel, values: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.6g}" for name, value in zip(model.joints, values, strict=True))
