"""Reader for all URDFs: it checks the XML, then uses yourdfpy; an error says in one sentence what is wrong."""

from __future__ import annotations

import os
from collections import Counter
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yourdfpy

from embodiedreamer_gym.errors import ModelError

MOST_JOINTS = 300
MOST_BYTES = 20_000_000
DEEPEST = 20  # nested tags; a URDF needs six
FARTHEST = 1e4  # m, from one joint to the next
MOVABLE = ("revolute", "continuous", "prismatic")
SHAPE = {"box": 3, "cylinder": 2, "sphere": 1}  # numbers that a shape has


def read_xml(urdf: str | Path) -> ElementTree.Element:
    """The XML of a URDF, given as a path or as text.

    Raises: ModelError when it is missing, larger than 20 MB, no XML, no <robot>, or nested too deeply.
    """
    data, name = _bytes(urdf)
    try:
        root = ElementTree.fromstring(data)  # yourdfpy's parser would silently repair broken XML
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ModelError(f"{name} cannot be read: it is not XML: {' '.join(str(error).split())}.") from error
    if root.tag != "robot":
        raise ModelError(f"{name} cannot be read: its root is <{root.tag}>, not <robot>.")
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    if level:
        raise ModelError(f"{name} cannot be read: tags are nested more than {DEEPEST} deep.")
    return root


def read_urdf(urdf: str | Path) -> yourdfpy.Robot:
    """Parse a URDF, given as a path or as text, without its meshes.

    Raises: ModelError when it is missing, no URDF, not one tree of bodies, or holds an impossible number.
    """
    data, name = _bytes(urdf)
    read_xml(urdf)
    path = Path(name.removeprefix("URDF "))
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are refused below
            robot = yourdfpy.URDF.load(BytesIO(data), load_meshes=False, build_scene_graph=False).robot
    except Exception as error:  # yourdfpy raises many kinds
        text = " ".join(str(error).split())[:200]
        raise ModelError(f"{name} cannot be read: {type(error).__name__}: {text}.") from error
    _check_names(robot, path)
    _check_numbers(robot, path)
    return robot


def _bytes(urdf: str | Path) -> tuple[bytes, str]:
    """Content of a URDF given as a path or as text, and its name for error messages."""
    if isinstance(urdf, str) and urdf.lstrip().startswith("<"):
        return urdf.encode(), "the URDF"
    path = Path(urdf)
    if not os.path.isfile(path):  # Path.is_file fails at a name that is too long
        raise ModelError(f"URDF {path} does not exist.")
    if path.stat().st_size > MOST_BYTES:
        raise ModelError(
            f"URDF {path} has {path.stat().st_size / 1e6:.0f} MB; at most {MOST_BYTES // 1_000_000} are read."
        )
    return path.read_bytes(), f"URDF {path}"


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
        raise ModelError(f"{path.name} has {len(robot.joints)} joints; at most {MOST_JOINTS} are supported.")
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
            raise ModelError(f"link '{link}' of {path.name} is not connected to the root link.")


def _check_numbers(robot: yourdfpy.Robot, path: Path) -> None:
    for link in robot.links:
        inertial = link.inertial
        values = [] if inertial is None else [inertial.mass, inertial.inertia, inertial.origin]
        if not all(np.all(np.isfinite(np.asarray(v, float))) for v in values if v is not None):
            raise ModelError(f"{path.name}: the inertial of link '{link.name}' is not finite.")
        for shape in (*link.visuals, *link.collisions):
            _check_shape(shape, link.name, path)
    for joint in robot.joints:
        for what in ("origin", "axis"):
            value = getattr(joint, what)
            if value is not None and not np.all(np.isfinite(np.asarray(value, float))):
                raise ModelError(f"{path.name}: the {what} of joint '{joint.name}' is not finite.")
        far = 0.0 if joint.origin is None else np.abs(joint.origin[:3, 3]).max()
        if far > FARTHEST:
            raise ModelError(
                f"{path.name}: the origin of joint '{joint.name}' is {far:g} m away; at most {FARTHEST:g} m is "
                "accepted. URDF lengths are in metres."
            )
        if joint.type in MOVABLE and (np.shape(joint.axis) != (3,) or not np.linalg.norm(joint.axis) > 0):
            raise ModelError(f"joint '{joint.name}' of {path.name} has an axis of length zero.")


def _check_shape(shape: yourdfpy.Visual | yourdfpy.Collision, link: str, path: Path) -> None:
    """Check the numbers of a box, cylinder, sphere or mesh."""
    if shape.origin is not None and not np.isfinite(shape.origin).all():
        raise ModelError(f"{path.name}: the origin of a shape of link '{link}' is not finite.")
    for kind, count in SHAPE.items():
        solid = getattr(shape.geometry, kind, None)
        if solid is None:
            continue
        sizes = np.concatenate([np.ravel(value) for value in vars(solid).values()]).astype(float)
        if len(sizes) != count or not np.all(np.isfinite(sizes) & (sizes > 0)):
            raise ModelError(
                f"{path.name}: a {kind} of link '{link}' needs {count} positive sizes, m, not {sizes.tolist()}."
            )
    mesh = getattr(shape.geometry, "mesh", None)
    if mesh is None:
        return
    scale = np.ravel(1.0 if mesh.scale is None else mesh.scale).astype(float)
    if not mesh.filename or len(scale) not in (1, 3) or not np.all(np.isfinite(scale) & (scale != 0)):
        raise ModelError(f"{path.name}: a mesh of link '{link}' needs a file name, and a scale of 1 or 3 numbers.")


def find_mesh(name: str, urdf: Path) -> Path | None:
    """Find a mesh by its path, or the part after the package's name, from the URDF's folder or one above it."""
    scheme, _, rest = name.rpartition("://")
    given = Path(rest)
    inner = Path(*given.parts[1:]) if scheme == "package" and len(given.parts) > 1 else given
    for folder in urdf.absolute().parents:
        for path in (folder / given, folder / inner):
            if path.is_file():
                return path
    return None


def resolve_meshes(root: ElementTree.Element, urdf: Path, suffixes: tuple[str, ...] = ()) -> list[str]:
    """Set the absolute paths of meshes in a URDF's XML; remove shapes whose mesh is missing or has another suffix.

    Returns the names of the meshes that were removed.
    """
    removed = []
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            file = find_mesh(str(mesh.get("filename", "")), urdf)
            if file is None or (suffixes and file.suffix.lower() not in suffixes):
                link.remove(shape)
                removed.append(str(mesh.get("filename")))
            else:
                mesh.set("filename", str(file.resolve()))
    return list(dict.fromkeys(removed))
