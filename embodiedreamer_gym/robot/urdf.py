"""Read a URDF through yourdfpy, and say in one sentence what is wrong with one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yourdfpy

from embodiedreamer_gym.errors import ModelError

MOST_JOINTS = 300


def read_urdf(path: Path) -> yourdfpy.URDF:
    """Parse a URDF without its meshes.

    Raises: ModelError when the file is missing, is no URDF, or does not describe one tree of bodies.
    """
    if not path.is_file():
        raise ModelError(f"URDF {path} does not exist.")
    try:
        root = ElementTree.fromstring(path.read_bytes())  # yourdfpy's parser repairs broken XML in silence
        if root.tag != "robot":
            raise ModelError(f"URDF {path} cannot be read: its root is <{root.tag}>, not <robot>.")
        urdf = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=False)
    except ModelError:
        raise
    except Exception as error:  # yourdfpy and the XML parsers raise many kinds
        text = " ".join(str(error).split())[:200]
        raise ModelError(f"URDF {path} cannot be read: {type(error).__name__}: {text}.") from error
    _check_names(urdf.robot, path)
    _check_numbers(urdf.robot, path)
    return urdf


def root_link(robot: yourdfpy.Robot, path: Path) -> str:
    """Name of the one link that is no joint's child.

    Raises: ModelError when there is none, or more than one.
    """
    children = {j.child for j in robot.joints}
    roots = [link.name for link in robot.links if link.name not in children]
    if len(roots) != 1:
        found = ", ".join(roots) or "its joints form a loop"
        raise ModelError(f"{path.name} must have one root link, but has {len(roots)}: {found}.")
    return roots[0]


def _check_names(robot: yourdfpy.Robot, path: Path) -> None:
    if not robot.links:
        raise ModelError(f"URDF {path} holds no link.")
    if len(robot.joints) > MOST_JOINTS:
        raise ModelError(
            f"{path.name} has {len(robot.joints)} joints; more than {MOST_JOINTS} are no robot of this kind."
        )
    links = {link.name for link in robot.links}
    for what, names in (("links", [k.name for k in robot.links]), ("joints", [j.name for j in robot.joints])):
        for name, count in Counter(names).items():
            if count > 1:
                raise ModelError(f"{path.name} has two {what} named '{name}'.")
    for joint in robot.joints:
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                raise ModelError(f"{path.name}: joint '{joint.name}' names the {end} link '{name}', which is missing.")
    for name, count in Counter(j.child for j in robot.joints).items():
        if count > 1:
            raise ModelError(f"link '{name}' of {path.name} is the child of two joints.")
    root, above = root_link(robot, path), {j.child: j.parent for j in robot.joints}
    for link in links:
        seen = {link}
        while link in above:
            link = above[link]
            if link in seen:
                raise ModelError(f"{path.name} must have one root link, but joints form a loop through '{link}'.")
            seen.add(link)
        if link != root:
            raise ModelError(f"link '{link}' of {path.name} hangs on nothing.")


def _check_numbers(robot: yourdfpy.Robot, path: Path) -> None:
    for link in robot.links:
        inertial = link.inertial
        values = [] if inertial is None else [inertial.mass, inertial.inertia, inertial.origin]
        if not all(np.all(np.isfinite(np.asarray(v, float))) for v in values if v is not None):
            raise ModelError(f"{path.name}: the inertial of link '{link.name}' is not finite.")
    for joint in robot.joints:
        for what in ("origin", "axis"):
            value = getattr(joint, what)
            if value is not None and not np.all(np.isfinite(np.asarray(value, float))):
                raise ModelError(f"{path.name}: the {what} of joint '{joint.name}' is not finite.")
