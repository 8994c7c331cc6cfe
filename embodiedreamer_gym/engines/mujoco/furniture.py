"""Table, props and ground as MuJoCo bodies, and their contacts with the robot's shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.engine import FINGER_FRICTION, TIP_ROLL, TIP_SPIN
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape
from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE
from embodiedreamer_gym.geometry.mesh import surface_of_revolution

THINGS, LINKS = 1, 2  # contact bits: things touch things and links, links touch only things
LINK_FRICTION = 0.5
STIFF = (0.004, 1.0)  # solref: s, and damping ratio, of a contact or a joint's stop
HARD = (0.95, 0.99, 0.0005, 0.5, 2.0)  # solimp: from 0 to half a millimetre (or milliradian) deep
SIDES = 24  # of a cylinder, as a mesh: MuJoCo finds all contact points of flat faces, but only one of its own cylinders
PARKED = (-2.0, 3.0, 0.0)  # m, place of the first prop before an episode
APART = 0.5  # m
UNSEEN, DRAWN = 0, 1  # groups of geoms


class Furniture:
    """Everything around the robot: call it with a MuJoCo specification to add it.

    props: of a task.
    fingers: names of the joints whose links grip objects.
    drawn: whether to add visual shapes besides collision shapes.
    table: whether there is a table.
    """

    def __init__(self, props: Sequence[Prop], fingers: Sequence[str], drawn: bool = False, table: bool = True) -> None:
        self.props, self.fingers, self.drawn, self.table = tuple(props), tuple(fingers), drawn, table

    def __call__(self, spec: Any) -> None:
        """Add ground, table and props, and set which shapes touch each other."""
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = 10.0  # friction stiffer than contact, so that gripped objects do not creep
        several = getattr(mujoco.mjtEnableBit, "mjENBL_MULTICCD", None)  # default since MuJoCo 4
        if several is not None:
            spec.option.enableflags |= int(several)
        for joint in spec.joints:
            joint.solref_limit, joint.solimp_limit = STIFF, HARD
        for body in spec.bodies:
            for geom in body.geoms:
                if geom.contype == geom.conaffinity == 0:  # drawn only
                    continue
                pads = any(joint.name in self.fingers for joint in body.joints)
                _touch(geom, FINGER_FRICTION if pads else LINK_FRICTION, LINKS, THINGS)
        ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(10.0, 10.0, 0.1), group=UNSEEN)
        _touch(ground, TABLE.friction, THINGS, THINGS | LINKS)
        if self.table:
            self._add(spec, TABLE, TABLE_CENTRE, 0)
        for i, prop in enumerate(self.props):
            self._add(spec, prop, parked(i), 1)

    def _add(self, spec: Any, prop: Prop, place: Sequence[float], priority: int) -> None:
        """Add a body with the prop's frame and the mass of its URDF; it is free unless the prop is fixed."""
        body = spec.worldbody.add_body(name=prop.name, pos=place)
        x, y, z = prop.size
        body.explicitinertial, body.mass, body.ipos = True, prop.mass, prop.centre
        body.inertia = [prop.mass / 12.0 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y))]
        if not prop.fixed:
            body.add_freejoint(name=prop.name)
        for i, shape in enumerate(prop.hull or prop.shapes):
            geom = _add_hull(spec, body, shape, f"{prop.name}{i}")
            _touch(geom, prop.friction, THINGS, THINGS | LINKS)
            geom.priority, geom.group = priority, UNSEEN
        for i, shape in enumerate(prop.shapes if self.drawn else ()):
            geom = _add_drawn(spec, body, shape, f"{prop.name}_drawn{i}")
            geom.contype, geom.conaffinity, geom.group = 0, 0, DRAWN
            geom.rgba = shape.rgba or prop.rgba


def parked(number: int) -> tuple[float, float, float]:
    """Place of a prop before an episode, m."""
    return PARKED[0] - number * APART, *PARKED[1:]


def _touch(geom: Any, friction: float, kind: int, others: int) -> None:
    """Make a shape touch others; in a contact, the friction of the higher priority counts, or the larger if equal."""
    geom.contype, geom.conaffinity, geom.condim = kind, others, 4
    geom.friction, geom.solref, geom.solimp = (friction, TIP_SPIN, TIP_ROLL), STIFF, HARD


def _place(shape: Shape) -> dict[str, Any]:
    return {"pos": shape.position, "quat": Rotation.from_euler("xyz", shape.rpy).as_quat(scalar_first=True)}


def _add_hull(spec: Any, body: Any, shape: Shape, name: str) -> Any:
    """A box, or the convex hull of a round shape."""
    if shape.kind == "box":
        return body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[edge / 2 for edge in shape.size], **_place(shape))
    spec.add_mesh(name=name, uservert=surface_of_revolution(shape.outline, SIDES)[0].ravel())
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **_place(shape))


def _add_drawn(spec: Any, body: Any, shape: Shape, name: str) -> Any:
    """A box, or the surface of a round shape, which may be hollow."""
    if shape.kind == "box":
        return _add_hull(spec, body, shape, name)
    points, faces = surface_of_revolution(shape.outline, SIDES)
    triangles = [(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)]
    spec.add_mesh(name=name, uservert=points.ravel(), userface=np.array(triangles).ravel(),
                  inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)  # fmt: skip
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **_place(shape))
