"""Table and props as MuJoCo's bodies, which touch each other and the robot's links."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape
from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.standin.film.geometry import turned
from embodiedreamer_gym.standin.plant import import_mujoco

THINGS, LINKS = 1, 2  # bits: things touch things and links, links touch things only
PAD_FRICTION, LINK_FRICTION = 1.0, 0.5  # of the fingers and of the other links, as in the PyBullet scene
TURNING, ROLLING = 0.002, 0.0001  # m
STIFF = (0.004, 1.0)  # solref: s, and damping ratio, of a contact or a joint's stop
HARD = (0.95, 0.99, 0.0005, 0.5, 2.0)  # solimp: from 0 to half a millimetre (or milliradian) deep
SIDES = 24  # of an upright cylinder: of meshes MuJoCo finds all points where flat faces meet, of its cylinders but one
PARKED = (-2.0, 3.0, 0.0)  # m, where props wait for an episode
APART = 0.5  # m


class Furniture:
    """What stands around the robot: called with a specification of MuJoCo's, it puts everything there.

    props: of a task; fingers: names of the joints whose links close on things. Joints stop at their limits.
    """

    def __init__(self, props: Sequence[Prop], fingers: Sequence[str]) -> None:
        self.props, self.fingers = tuple(props), tuple(fingers)

    def __call__(self, spec: Any) -> None:
        """Add floor, table and props; say which shapes touch which."""
        mujoco = import_mujoco()
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = 10.0  # friction stiffer than contact: what is held does not creep
        several = getattr(mujoco.mjtEnableBit, "mjENBL_MULTICCD", None)  # on by default from MuJoCo 4 on
        if several is not None:
            spec.option.enableflags |= int(several)
        for joint in spec.joints:
            joint.solref_limit, joint.solimp_limit = STIFF, HARD
        for body in spec.bodies:
            for geom in body.geoms:
                pads = any(joint.name in self.fingers for joint in body.joints)
                friction = PAD_FRICTION if pads else LINK_FRICTION
                _touch(geom, friction, LINKS, THINGS)
        floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(10.0, 10.0, 0.1))
        _touch(floor, TABLE.friction, THINGS, THINGS | LINKS)
        _add_prop(spec, TABLE, TABLE_CENTRE, 0)
        for i, prop in enumerate(self.props):
            _add_prop(spec, prop, (PARKED[0] - i * APART, *PARKED[1:]), 1)


def _touch(geom: Any, friction: float, kind: int, others: int) -> None:
    """Make a shape touch others; of two shapes' friction that of higher priority counts, else the larger."""
    geom.contype, geom.conaffinity, geom.condim = kind, others, 4
    geom.friction, geom.solref, geom.solimp = (friction, TURNING, ROLLING), STIFF, HARD


def _add_prop(spec: Any, prop: Prop, place: Sequence[float], priority: int) -> None:
    """A body whose frame is the prop's, with the mass of its URDF; loose unless it is fixed."""
    body = spec.worldbody.add_body(name=prop.name, pos=place)
    x, y, z = prop.size
    body.explicitinertial, body.mass, body.ipos = True, prop.mass, prop.centre
    body.inertia = [prop.mass / 12.0 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y))]
    if not prop.fixed:
        body.add_freejoint(name=prop.name)
    for i, shape in enumerate(prop.hull or prop.shapes):
        _touch(_add_shape(spec, body, shape, f"{prop.name}{i}"), prop.friction, THINGS, THINGS | LINKS)
        body.geoms[-1].priority = priority


def _add_shape(spec: Any, body: Any, shape: Shape, name: str) -> Any:
    """A box, or the convex hull of what is round."""
    kinds = import_mujoco().mjtGeom
    place = {"pos": shape.position, "quat": Rotation.from_euler("xyz", shape.rpy).as_quat(scalar_first=True)}
    if shape.kind == "box":
        return body.add_geom(type=kinds.mjGEOM_BOX, size=[edge / 2 for edge in shape.size], **place)
    spec.add_mesh(name=name, uservert=_corners(shape).ravel())
    return body.add_geom(type=kinds.mjGEOM_MESH, meshname=name, **place)


def _corners(shape: Shape) -> np.ndarray:
    """Points (N, 3) of a cylinder or a turned shape, m."""
    outline = list(zip(shape.size[::2], shape.size[1::2], strict=True))
    if shape.kind == "cylinder":
        radius, half = shape.size[0], shape.size[1] / 2
        outline = [(0.0, -half), (radius, -half), (radius, half), (0.0, half)]
    return turned(outline, SIDES)[0]
