"""Adds a visual shape without collisions to a link of a URDF."""

from __future__ import annotations

import copy
import os
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.robot.urdf import read_xml, resolve_meshes

CARVED = "carved"  # name of the visual


def add_visual(
    urdf: Path, link: str, vertices: np.ndarray, faces: np.ndarray, colour: Sequence[float], out: Path
) -> None:
    """Write a URDF in which a link has one more visual, a mesh <name>_<link>.obj beside it; it replaces an earlier one.

    vertices (V, 3): m, in the link's frame; faces (F, 3); colour (3,): RGB, 0 to 1; out: path of the new URDF.
    Raises: ModelError for a link that the URDF does not have, a missing mesh, or a file that cannot be written.
    """
    root = read_xml(urdf)
    found = [one for one in root.iter("link") if one.get("name") == link]
    if not found:
        names = ", ".join(str(one.get("name")) for one in root.iter("link"))
        raise ModelError(f"{urdf.name} has no link '{link}'; links: {names}.")
    if missing := resolve_meshes(root, urdf):
        raise ModelError(f"{urdf.name}: the mesh {missing[0]} is missing; put it beside the URDF.")
    folder = os.path.realpath(out.parent)
    for mesh in root.iter("mesh"):
        mesh.set("filename", Path(os.path.relpath(str(mesh.get("filename")), folder)).as_posix())
    file = out.with_name(f"{out.stem}_{link}.obj")
    _add(found[0], file.name, colour)
    with atomic_file(file, ModelError, ".part.obj") as part:
        trimesh.Trimesh(vertices, faces, process=False).export(str(part), file_type="obj", include_normals=False)
    with atomic_file(out, ModelError, ".part.urdf") as part:
        Path(part).write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")


def _add(link: Element, mesh: str, colour: Sequence[float]) -> None:
    """Add the visual to a link's XML."""
    for visual in link.findall("visual"):
        if visual.get("name") == CARVED:
            link.remove(visual)
    if link.find("visual") is None:  # its collision shapes were drawn so far: keep them visible
        for shape in link.findall("collision"):
            drawn = copy.deepcopy(shape)
            drawn.tag = "visual"
            link.append(drawn)
    visual = SubElement(link, "visual", name=CARVED)
    SubElement(SubElement(visual, "geometry"), "mesh", filename=mesh)
    material = SubElement(visual, "material", name=f"{CARVED}_{link.get('name')}")
    SubElement(material, "color", rgba=" ".join(f"{share:.3f}" for share in (*colour, 1.0)))
