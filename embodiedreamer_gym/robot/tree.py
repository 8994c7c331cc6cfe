"""A URDF as arrays: the moving bodies of a robot, with fixed links merged into them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yourdfpy

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.urdf import MOVABLE, read_urdf, root_link

WORLD = -1


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Moving bodies, ordered so that parents come first (k bodies, n driven joints).

    parent (k,): body index or -1 for the world; rotation (k, 3, 3), origin (k, 3) m: the joint's frame in the
    parent's; axis (k, 3): in the joint's frame; prismatic (k,) bool; coordinate (k,): the driven joint that moves
    it; gain, offset (k,): joint value = gain * coordinate + offset (mimic joints, normalised grippers);
    mass (k,) kg, first_moment (k, 3) kg m, inertia (k, 3, 3) kg m^2 about the body's origin; arm (n,):
    branch of the robot that each driven joint belongs to; tips: end-effector link -> (body, rotation, point).
    """

    joint_names: tuple[str, ...]
    parent: np.ndarray
    rotation: np.ndarray
    origin: np.ndarray
    axis: np.ndarray
    prismatic: np.ndarray
    coordinate: np.ndarray
    gain: np.ndarray
    offset: np.ndarray
    mass: np.ndarray
    first_moment: np.ndarray
    inertia: np.ndarray
    arm: np.ndarray
    tips: dict[str, tuple[int, np.ndarray, np.ndarray]]
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    units: tuple[str, ...]

    @property
    def bodies(self) -> int:
        """Number of moving bodies."""
        return len(self.parent)

    @property
    def arms(self) -> int:
        """Number of branches that driven joints form."""
        return int(self.arm.max()) + 1

    def __repr__(self) -> str:
        return f"KinematicTree({self.bodies} bodies, {len(self.arm)} driven joints, {self.arms} arms)"


def build_tree(
    path: Path,
    joints: tuple[str, ...],
    normalised: dict[str, tuple[float, float]] | None = None,
    end_effectors: tuple[str, ...] = (),
) -> KinematicTree:
    """Turn a URDF into arrays for the driven joints named; other movable joints stay at zero.

    Raises: ModelError for a missing joint or link, a moving body without mass, or an inertia no body can have.
    """
    robot = read_urdf(path)
    normalised = normalised or {}
    if len(set(end_effectors)) != len(end_effectors):
        raise ModelError(
            f"the end effectors that the model names of {path.name} are not unique: {', '.join(end_effectors)}."
        )
    by_name = {j.name: j for j in robot.joints}
    movable = [j.name for j in robot.joints if j.type in MOVABLE]
    for name in joints:
        if name not in movable:
            raise ModelError(f"joint '{name}' is not a movable joint of {path.name}; movable: {', '.join(movable)}.")
    if len(set(joints)) != len(joints):
        raise ModelError(f"the joints that the model names of {path.name} are not unique: {', '.join(joints)}.")
    children: dict[str, list[yourdfpy.Joint]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    root = root_link(robot, path)
    links = {link.name: link for link in robot.links}
    rows: list[dict] = []
    frames: dict[str, tuple[int, np.ndarray, np.ndarray]] = {}

    def visit(link: str, body: int, rotation: np.ndarray, origin: np.ndarray) -> None:
        frames[link] = (body, rotation, origin)
        if body != WORLD:
            _add_link(rows[body], links[link], rotation, origin)
        for joint in children.get(link, []):
            place = np.eye(4) if joint.origin is None else np.asarray(joint.origin, float)
            turned, moved = rotation @ place[:3, :3], origin + rotation @ place[:3, 3]
            driver, gain, offset = _driver(joint, by_name, joints, normalised)
            if driver is None:
                visit(joint.child, body, turned, moved)
                continue
            axis = np.asarray(joint.axis, float)
            rows.append(
                {"name": joint.name, "parent": body, "rotation": turned, "origin": moved,
                 "axis": axis / np.linalg.norm(axis), "prismatic": joint.type == "prismatic",
                 "coordinate": driver, "gain": gain, "offset": offset,
                 "mass": 0.0, "first_moment": np.zeros(3), "inertia": np.zeros((3, 3))}
            )  # fmt: skip
            visit(joint.child, len(rows) - 1, np.eye(3), np.zeros(3))

    visit(root, WORLD, np.eye(3), np.zeros(3))
    _check_bodies(rows, path)
    parent = np.array([row["parent"] for row in rows], np.int64)
    coordinate = np.array([row["coordinate"] for row in rows], np.int64)
    lower, upper, speed = _limits(by_name, joints, normalised)
    for name in end_effectors:
        if name not in frames or frames[name][0] == WORLD:
            moving = [link for link, frame in frames.items() if frame[0] != WORLD]
            raise ModelError(f"end effector '{name}' is not a moving link of {path.name}; moving: {', '.join(moving)}.")
    arm = _arms(parent, coordinate, len(joints))
    tips = {name: frames[name] for name in end_effectors} or _outermost(frames, arm, coordinate)
    return KinematicTree(
        joint_names=tuple(row["name"] for row in rows),
        parent=parent,
        coordinate=coordinate,
        prismatic=np.array([row["prismatic"] for row in rows]),
        arm=arm,
        tips=tips,
        lower=lower,
        upper=upper,
        velocity=speed,
        units=tuple("1" if j in normalised else "m" if by_name[j].type == "prismatic" else "rad" for j in joints),
        **{k: np.array([row[k] for row in rows], float)
           for k in ("rotation", "origin", "axis", "gain", "offset", "mass", "first_moment", "inertia")},
    )  # fmt: skip


def _driver(joint, by_name, joints, normalised) -> tuple[int | None, float, float]:
    """Which driven joint moves this one, and how: value = gain * coordinate + offset."""
    if joint.type not in MOVABLE:
        return None, 1.0, 0.0
    name, gain, offset = joint.name, 1.0, 0.0
    if joint.mimic is not None and joint.name not in joints:
        name, gain, offset = joint.mimic.joint, joint.mimic.multiplier or 1.0, joint.mimic.offset or 0.0
    if name not in joints:
        return None, 1.0, 0.0
    if name in normalised:
        zero, one = normalised[name]
        gain, offset = gain * (one - zero), gain * zero + offset
    return joints.index(name), float(gain), float(offset)


def _add_link(row: dict, link: yourdfpy.Link, rotation: np.ndarray, origin: np.ndarray) -> None:
    """Merge a link's mass into the moving body that carries it."""
    if link.inertial is None or not link.inertial.mass:
        return
    mass = float(link.inertial.mass)
    place = np.eye(4) if link.inertial.origin is None else np.asarray(link.inertial.origin, float)
    about_com = np.zeros((3, 3)) if link.inertial.inertia is None else np.asarray(link.inertial.inertia, float)
    turn = rotation @ place[:3, :3]
    centre = origin + rotation @ place[:3, 3]
    row["mass"] += mass
    row["first_moment"] = row["first_moment"] + mass * centre
    row["inertia"] = (
        row["inertia"] + turn @ about_com @ turn.T + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    )


def _check_bodies(rows: list[dict], path: Path) -> None:
    for row in rows:
        if not np.isfinite(row["mass"]) or row["mass"] <= 0:
            raise ModelError(
                f"{path.name}: the links moved by joint '{row['name']}' have mass {row['mass']:g}; give them a positive mass."
            )
        centre = row["first_moment"] / row["mass"]
        about_com = row["inertia"] - row["mass"] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        if not np.all(np.isfinite(about_com)) or np.linalg.eigvalsh(about_com).min() < -1e-9 * (
            1 + np.trace(row["inertia"])
        ):
            raise ModelError(
                f"{path.name}: the links moved by joint '{row['name']}' have an inertia that no body can have."
            )


def _limits(by_name, joints, normalised) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lower, upper, speed = (np.full(len(joints), v) for v in (-np.inf, np.inf, np.inf))
    for i, name in enumerate(joints):
        limit = by_name[name].limit
        if name in normalised:
            lower[i], upper[i] = 0.0, 1.0
        elif limit is not None and by_name[name].type != "continuous":
            low, high = limit.lower, limit.upper
            if low is not None and high is not None and low < high:
                lower[i], upper[i] = low, high
        if limit is not None and limit.velocity:
            stroke = abs(normalised[name][1] - normalised[name][0]) if name in normalised else 1.0
            speed[i] = limit.velocity / stroke
    return lower, upper, speed


def _arms(parent: np.ndarray, coordinate: np.ndarray, n: int) -> np.ndarray:
    """Number the branches that start at the world; a joint belongs to the branch of its body."""
    branch = np.zeros(len(parent), np.int64)
    roots = 0
    for body, up in enumerate(parent):
        if up == WORLD:
            branch[body], roots = roots, roots + 1
        else:
            branch[body] = branch[up]
    arm = np.array([branch[np.flatnonzero(coordinate == j)[0]] for j in range(n)], np.int64)
    return np.unique(arm, return_inverse=True)[1].astype(np.int64)


def _outermost(frames, arm: np.ndarray, coordinate: np.ndarray) -> dict:
    """The deepest link of each arm, if the user names no end effector."""
    tips: dict[int, str] = {}
    for link, (body, _, _) in frames.items():  # parents come before children
        if body != WORLD:
            tips[int(arm[coordinate[body]])] = link
    return {tips[a]: frames[tips[a]] for a in sorted(tips)}
