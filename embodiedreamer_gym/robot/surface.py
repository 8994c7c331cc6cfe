"""The visible surface of a robot: the shapes of its URDF, link by link, and their poses at given joint angles."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh
import yourdfpy

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.geometry.articulated_mesh import Body
from embodiedreamer_gym.robot.forward_kinematics import joint_poses, joint_values, joints_from_root
from embodiedreamer_gym.robot.model import RobotModel
from embodiedreamer_gym.robot.urdf import MOVABLE, find_mesh, read_urdf, root_link

ROUND = 32  # sides of a cylinder


class Surface:
    """Shapes of a URDF's links, and their poses.

    joints: names of the columns of joint angles; normalised: joint -> its values, rad or m, at 0 and at 1. Movable
    joints not named stay at zero, or follow the joint they mimic. body: triangles of every link that has a shape.
    skeleton: show rods between the joints if the URDF's shapes are missing or cannot be read.
    Raises: ModelError for a joint the URDF does not have, a mesh that cannot be read, or a robot without shapes.
    """

    def __init__(
        self, urdf: str | Path, joints: Sequence[str], normalised: Mapping[str, tuple[float, float]] | None = None,
        skeleton: bool = False,
    ) -> None:  # fmt: skip
        path = Path(urdf)
        robot = read_urdf(path)
        self.joints = tuple(joints)
        self._normalised = dict(normalised or {})
        movable = [joint.name for joint in robot.joints if joint.type in MOVABLE]
        for name in self.joints:
            if name not in movable:
                raise ModelError(
                    f"joint '{name}' is not a movable joint of {path.name}; movable: {', '.join(movable)}."
                )
        if len(set(self.joints)) != len(self.joints):
            raise ModelError(f"a joint is named twice: {', '.join(self.joints)}.")
        self._root = root_link(robot, path)
        self._order = joints_from_root(robot, self._root)
        try:
            self.body = _body(robot, path)
        except ModelError:
            if not skeleton:
                raise
            self.body = _skeleton(robot)

    @staticmethod
    def of_model(model: RobotModel, skeleton: bool = False) -> Surface:
        """Return the surface of a robot model."""
        return Surface(model.urdf, model.joints, model.normalised, skeleton)

    def __repr__(self) -> str:
        return f"Surface({len(self.joints)} joints, {self.body!r})"

    def poses(self, angles: np.ndarray) -> np.ndarray:
        """Poses (T, P, 4, 4) of the body's parts in the root link's frame, m, at joint angles (T, n), rad or m.

        Raises: ModelError when the angles are not (T, n) finite numbers.
        """
        places = self._places(angles)
        return np.stack([places[name] for name in self.body.names], axis=1)

    def link_poses(self, link: str, angles: np.ndarray) -> np.ndarray:
        """Poses (T, 4, 4) of a link, with or without a shape; frame and units as in `poses`.

        Raises: ModelError for a link that the robot does not have, or when the angles are not (T, n) finite numbers.
        """
        places = self._places(angles)
        if link not in places:
            raise ModelError(f"the robot has no link '{link}'; it has {', '.join(places)}.")
        return places[link]

    def _places(self, angles: np.ndarray) -> dict[str, np.ndarray]:
        """Poses (T, 4, 4) of all links in the root link's frame."""
        angles = np.asarray(angles, float)
        if angles.ndim != 2 or angles.shape[1] != len(self.joints):
            raise ModelError(
                f"joint angles have the shape {angles.shape}, but must be (T, {len(self.joints)}): one column for each "
                f"of {', '.join(self.joints)}."
            )
        if not np.isfinite(angles).all():
            row = int(np.flatnonzero(~np.isfinite(angles).all(axis=1))[0])
            raise ModelError(f"joint angles of row {row} are not finite; leave such rows out.")
        given = {name: self._value(name, column) for name, column in zip(self.joints, angles.T, strict=True)}
        places = {self._root: np.broadcast_to(np.eye(4), (len(angles), 4, 4))}
        for joint in self._order:
            motion = joint_poses(joint, joint_values(joint, given), len(angles))
            places[joint.child] = places[joint.parent] @ motion
        return places

    def points(self, angles: np.ndarray) -> np.ndarray:
        """Vertices (T, K, 3) of the body in the root link's frame, m, at joint angles (T, n)."""
        return self.body.at(self.poses(angles))

    def locate(self, link: str, points: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Convert points (T, 3), m, from a visible link's frame to the root link's, (T, 3), at joint angles (T, n).

        Raises: ModelError for a link without shape, or when there are not as many points as rows of angles.
        """
        if link not in self.body.names:
            raise ModelError(f"the robot has no visible link '{link}'; it has {', '.join(self.body.names)}.")
        points = np.asarray(points, float)
        if points.shape != (len(angles), 3):
            raise ModelError(f"{len(angles)} rows of angles need points ({len(angles)}, 3), not {points.shape}.")
        pose = self.poses(angles)[:, self.body.names.index(link)]
        return np.einsum("tij,tj->ti", pose[:, :3, :3], points) + pose[:, :3, 3]

    def movers(self) -> tuple[str | None, ...]:
        """For each part of the body, the last joint of `joints` that moves it; None for parts that do not move."""
        above = {joint.child: joint for joint in self._order}

        def mover(link: str) -> str | None:
            while link in above:
                joint = above[link]
                leader = joint.mimic.joint if joint.mimic is not None else ""
                for name in (joint.name, leader):
                    if name in self.joints:
                        return name
                link = joint.parent
            return None

        return tuple(mover(name) for name in self.body.names)

    def _value(self, name: str, column: np.ndarray) -> np.ndarray:
        if name not in self._normalised:
            return column
        zero, one = self._normalised[name]
        return zero + (one - zero) * column


def _body(robot: yourdfpy.Robot, path: Path) -> Body:
    """Triangles of all links that have a shape: its visuals, or else its collision shapes."""
    vertices, faces, part, names = [], [], [], []
    count = 0
    for link in robot.links:
        shapes = link.visuals or link.collisions
        for shape in shapes:
            if shape.geometry is None:
                continue
            mesh = _mesh(shape.geometry, link.name, path)
            if shape.origin is not None:
                mesh.apply_transform(np.asarray(shape.origin, float))
            if link.name not in names:
                names.append(link.name)
            vertices.append(mesh.vertices)
            faces.append(mesh.faces + count)
            part.append(np.full(len(mesh.vertices), names.index(link.name)))
            count += len(mesh.vertices)
    if not names:
        raise ModelError(f"{path.name} gives no link a shape, so the robot cannot be seen; use a URDF with visuals.")
    return Body(np.concatenate(vertices), np.concatenate(faces), np.concatenate(part), tuple(names))


def _skeleton(robot: yourdfpy.Robot) -> Body:
    """A rod from every link's frame to each of its joints, and a ball at the link's frame."""
    offsets = [np.zeros(3) if j.origin is None else np.asarray(j.origin, float)[:3, 3] for j in robot.joints]
    lengths = [float(np.linalg.norm(offset)) for offset in offsets]
    radius = 0.08 * (float(np.median([x for x in lengths if x > 0.0])) if any(lengths) else 0.1)
    parts: list[tuple[str, trimesh.Trimesh]] = []
    for link in robot.links:
        parts.append((link.name, trimesh.creation.icosphere(subdivisions=1, radius=1.5 * radius)))
        for joint, offset, length in zip(robot.joints, offsets, lengths, strict=True):
            if joint.parent == link.name and length > radius:
                ends = np.array([np.zeros(3), offset])
                parts.append((link.name, trimesh.creation.cylinder(radius, segment=ends, sections=12)))
    names = tuple(link.name for link in robot.links)
    starts = np.cumsum([0, *(len(mesh.vertices) for _, mesh in parts)])
    return Body(
        np.concatenate([mesh.vertices for _, mesh in parts]),
        np.concatenate([mesh.faces + start for (_, mesh), start in zip(parts, starts[:-1], strict=True)]),
        np.concatenate([np.full(len(mesh.vertices), names.index(name)) for name, mesh in parts]),
        names,
    )


def _mesh(geometry: yourdfpy.Geometry, link: str, path: Path) -> trimesh.Trimesh:
    """One shape as triangles, m, in its own frame."""
    if geometry.box is not None:
        return trimesh.creation.box(np.asarray(geometry.box.size, float))
    if geometry.cylinder is not None:
        return trimesh.creation.cylinder(geometry.cylinder.radius, geometry.cylinder.length, sections=ROUND)
    if geometry.sphere is not None:
        return trimesh.creation.icosphere(subdivisions=2, radius=geometry.sphere.radius)
    if geometry.mesh is None:
        raise ModelError(f"{path.name}: link '{link}' has a shape that is not a box, cylinder, sphere or mesh.")
    file = find_mesh(geometry.mesh.filename, path)
    if file is None:
        raise ModelError(
            f"{path.name}: the mesh {geometry.mesh.filename} of link '{link}' is missing; put it beside the URDF."
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about materials, which are not used
            mesh = trimesh.load(str(file), force="mesh", process=False, skip_materials=True)
    except Exception as error:  # trimesh's readers raise many kinds
        text = " ".join(str(error).split())[:200]
        raise ModelError(f"{path.name}: mesh {file.name} of link '{link}' cannot be read: {text}.") from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ModelError(f"{path.name}: mesh {file.name} of link '{link}' holds no triangle.")
    if geometry.mesh.scale is not None:
        mesh.apply_scale(np.broadcast_to(np.asarray(geometry.mesh.scale, float), 3))
    return mesh
