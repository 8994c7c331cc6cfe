"""Original arms made of primitives, with the true parameters of their servos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.errors import ModelError

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Servo:
    """True servo parameters of an arm, each (n,): N m/rad, N m s/rad, kg m^2, N m s/rad."""

    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    rotor_inertia: tuple[float, ...]
    viscous_friction: tuple[float, ...]


@dataclass(frozen=True)
class _Link:
    """A joint and the link that it moves: a solid bar from the joint's frame to `end`; m, kg."""

    axis: Vector
    origin: Vector
    end: Vector
    width: float
    mass: float
    limit: tuple[float, float]
    home: float
    effort: float


X, Y, Z, MINUS_Y = (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0)
HIGHEST_SPEED = 3.0  # rad/s, speed limit of every joint

# Similar to Piper and ViperX: waist, shoulder, elbow, then roll, pitch, roll; 4.1 kg moving, links 0.29 and 0.25 m.
_ARM6 = (
    _Link(Z, (0, 0, 0.08), (0, 0, 0.05), 0.09, 0.80, (-2.6, 2.6), 0.0, 40),
    _Link(Y, (0, 0, 0.05), (0.29, 0, 0), 0.06, 1.20, (-2.2, 0.9), -0.9, 40),
    _Link(Y, (0.29, 0, 0), (0.20, 0, 0.015), 0.05, 0.90, (-0.3, 2.7), 1.4, 40),
    _Link(X, (0.25, 0, 0), (0.06, 0, 0.008), 0.045, 0.50, (-1.7, 1.7), 0.0, 10),
    _Link(Y, (0.05, 0, 0), (0.07, 0, 0), 0.04, 0.40, (-1.5, 1.5), 0.3, 10),
    _Link(X, (0.07, 0, 0), (0.06, 0.02, 0), 0.04, 0.30, (-2.6, 2.6), 0.0, 10),
)
# Another geometry: three parallel pitch axes, then yaw and pitch; 5.9 kg moving, links 0.34 and 0.22 m.
_ARM6B = (
    _Link(Z, (0, 0, 0.10), (0, 0.04, 0.06), 0.10, 1.30, (-2.8, 2.8), 0.0, 60),
    _Link(Y, (0, 0.08, 0.06), (0, 0, 0.34), 0.07, 1.90, (-1.6, 1.6), 0.5, 60),
    _Link(MINUS_Y, (0, -0.06, 0.34), (0.02, 0, 0.22), 0.06, 1.20, (-2.4, 2.4), -0.9, 60),
    _Link(Y, (0, 0, 0.22), (0, 0.05, 0.04), 0.05, 0.70, (-1.9, 1.9), 0.4, 15),
    _Link(Z, (0, 0.05, 0.05), (0.05, 0, 0.05), 0.045, 0.50, (-2.6, 2.6), 0.0, 15),
    _Link(Y, (0, 0, 0.08), (0.02, 0, 0.09), 0.04, 0.30, (-1.8, 1.8), 0.5, 15),
)
# Seven axes in the order of a KUKA iiwa, at about half its weight (8.6 kg moving).
_ARM7 = (
    _Link(Z, (0, 0, 0.15), (0, 0, 0.17), 0.11, 1.80, (-2.9, 2.9), 0.0, 80),
    _Link(Y, (0, 0, 0.19), (0, 0.02, 0.19), 0.10, 1.80, (-2.0, 2.0), 0.6, 80),
    _Link(Z, (0, 0, 0.21), (0, 0.01, 0.17), 0.09, 1.40, (-2.9, 2.9), 0.0, 60),
    _Link(MINUS_Y, (0, 0, 0.19), (0, 0.02, 0.19), 0.08, 1.40, (-2.0, 2.0), 1.2, 60),
    _Link(Z, (0, 0, 0.21), (0, 0.01, 0.17), 0.07, 0.90, (-2.9, 2.9), 0.0, 40),
    _Link(Y, (0, 0, 0.19), (0, 0.02, 0.06), 0.06, 0.90, (-2.0, 2.0), 0.5, 20),
    _Link(Z, (0, 0, 0.08), (0.02, 0, 0.06), 0.06, 0.40, (-3.0, 3.0), 0.0, 20),
)
# Hangs straight down at zero.
_PENDULUM1 = (_Link(Y, (0, 0, 0.6), (0, 0, -0.3), 0.04, 1.0, (-3.1, 3.1), 0.0, 20),)

_ARMS = {"arm6": _ARM6, "arm6b": _ARM6B, "arm7": _ARM7, "pendulum1": _PENDULUM1}
ARMS = tuple(_ARMS)

TRUTH = {
    "arm6": Servo(
        stiffness=(200, 250, 180, 60, 40, 20),
        damping=(8, 10, 7, 1.6, 1.0, 0.4),
        rotor_inertia=(0.05, 0.05, 0.04, 0.008, 0.005, 0.003),
        viscous_friction=(1.5, 1.5, 1.2, 0.3, 0.2, 0.1),
    ),
    "arm6b": Servo(
        stiffness=(220, 250, 200, 90, 50, 25),
        damping=(9, 10, 8, 2.5, 1.2, 0.5),
        rotor_inertia=(0.05, 0.05, 0.045, 0.01, 0.006, 0.003),
        viscous_friction=(1.5, 1.4, 1.2, 0.4, 0.2, 0.1),
    ),
    "arm7": Servo(
        stiffness=(250, 250, 220, 200, 90, 60, 25),
        damping=(10, 10, 9, 8, 3, 1.6, 0.6),
        rotor_inertia=(0.05, 0.05, 0.05, 0.04, 0.012, 0.008, 0.004),
        viscous_friction=(1.5, 1.5, 1.2, 1.2, 0.4, 0.3, 0.1),
    ),
    "pendulum1": Servo(stiffness=(40,), damping=(1.5,), rotor_inertia=(0.01,), viscous_friction=(0.2,)),
}


def arm_joints(name: str) -> tuple[str, ...]:
    """Joint names of an arm, base first."""
    return tuple(f"joint{i + 1}" for i in range(len(_find(name))))


def arm_home(name: str) -> np.ndarray:
    """A pose (n,) rad with room to move on both sides of every joint."""
    return np.array([link.home for link in _find(name)])


def arm_urdf(name: str) -> str:
    """The arm as URDF text: links `base`, `link1` ..., and the nearly massless frame `tip`.

    Raises: ModelError when there is no arm of that name.
    """
    links = _find(name)
    parts = ['<?xml version="1.0"?>', f'<robot name="{name}">', _bar("base", (0, 0, 0.08), 0.12, 1.0)]
    for i, link in enumerate(links, 1):
        parent = f"link{i - 1}" if i > 1 else "base"
        parts.append(_bar(f"link{i}", link.end, link.width, link.mass))
        parts.append(
            f'  <joint name="joint{i}" type="revolute">\n'
            f'    <parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="{_text(link.origin)}" rpy="0 0 0"/>\n'
            f'    <axis xyz="{_text(link.axis)}"/><limit lower="{link.limit[0]}" upper="{link.limit[1]}" '
            f'effort="{link.effort}" velocity="{HIGHEST_SPEED}"/>\n  </joint>'
        )
    parts.append(
        '  <link name="tip">\n    <inertial><origin xyz="0 0 0"/><mass value="1e-06"/>'
        '<inertia ixx="1e-09" ixy="0" ixz="0" iyy="1e-09" iyz="0" izz="1e-09"/></inertial>\n  </link>\n'
        '  <joint name="tip_mount" type="fixed">\n'
        f'    <parent link="link{len(links)}"/><child link="tip"/>'
        f'<origin xyz="{_text(links[-1].end)}" rpy="0 0 0"/>\n  </joint>\n</robot>\n'
    )
    return "\n".join(parts)


def _find(name: str) -> tuple[_Link, ...]:
    if name not in _ARMS:
        raise ModelError(f"there is no stand-in arm '{name}'; give one of {', '.join(_ARMS)}.")
    return _ARMS[name]


def _text(values) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def _bar(name: str, end: Vector, width: float, mass: float) -> str:
    """A link: a solid box from the origin to `end`, rotated so that its x axis lies along the bar."""
    x, y, z = end
    length = float(np.linalg.norm(end))
    rpy = (0.0, -float(np.arctan2(z, np.hypot(x, y))), float(np.arctan2(y, x)))
    across, along = mass * width**2 / 6, mass * (width**2 + length**2) / 12
    origin = f'<origin xyz="{_text((x / 2, y / 2, z / 2))}" rpy="{_text(rpy)}"/>'
    shape = f'<geometry><box size="{_text((length, width, width))}"/></geometry>'
    return (
        f'  <link name="{name}">\n    <inertial>{origin}<mass value="{mass}"/>'
        f'<inertia ixx="{across:.9g}" ixy="0" ixz="0" iyy="{along:.9g}" iyz="0" izz="{along:.9g}"/>'
        f"</inertial>\n"
        f"    <visual>{origin}{shape}</visual>\n    <collision>{origin}{shape}</collision>\n  </link>"
    )
