"""Three arms of common designs as data, and the URDF text that a user would have for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Joint:
    """A hinge and the link after it; m, kg and rad; the joint's frame is the link's frame.

    at (3,): position in the frame of the previous link; centre and box (3,): centre of mass, and edges of a box with
    the link's inertia; home and reach: middle and half range of its motions; hertz: frequency of servo and joint at
    home, which determines the nominal gains; rotor: rotor inertia at the joint, kg m^2.
    """

    name: str
    at: tuple[float, float, float]
    axis: tuple[int, int, int]
    mass: float
    centre: tuple[float, float, float]
    box: tuple[float, float, float]
    home: float
    reach: float
    hertz: float
    rotor: float

    @property
    def inertia(self) -> np.ndarray:
        """Moments of inertia of the box about the centre of mass, (3,), kg m^2."""
        squares = np.square(self.box)
        return self.mass / 12 * (squares.sum() - squares)


@dataclass(frozen=True)
class Arm:
    """Joints from the base to the end, and the position of the tip in the last link's frame, m."""

    name: str
    joints: tuple[Joint, ...]
    tip: tuple[float, float, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    def each(self, key: str) -> np.ndarray:
        """Values of one field for all joints, (n,) or (n, 3)."""
        return np.array([getattr(joint, key) for joint in self.joints], float)


X, Y, Z, BACK = (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0)

SERVO6 = Arm(
    "servo6",
    (
        Joint("waist", (0, 0, 0.07), Z, 0.50, (0, 0, 0.02), (0.09, 0.08, 0.06), 0.0, 0.8, 5.5, 0.02),
        Joint("shoulder", (0, 0, 0.05), Y, 0.62, (0.01, 0.004, 0.11), (0.05, 0.06, 0.22), 0.25, 0.5, 5.0, 0.03),
        Joint("elbow", (0.03, 0, 0.21), Y, 0.45, (0.07, -0.003, 0.015), (0.17, 0.05, 0.05), 0.35, 0.6, 5.5, 0.02),
        Joint("forearm_roll", (0.16, 0, 0.02), X, 0.26, (0.03, 0, 0), (0.08, 0.045, 0.045), 0.0, 0.8, 7.0, 0.006),
        Joint("wrist_angle", (0.07, 0, 0), Y, 0.27, (0.03, 0, 0.004), (0.07, 0.05, 0.04), 0.3, 0.7, 7.0, 0.005),
        Joint("wrist_rotate", (0.06, 0, 0), X, 0.35, (0.04, 0.008, 0.005), (0.09, 0.08, 0.04), 0.0, 1.0, 7.5, 0.004),
    ),
    (0.10, 0.0, 0.0),
)
DESK5 = Arm(
    "desk5",
    (
        Joint("pan", (0.02, 0, 0.055), Z, 0.19, (-0.01, 0, 0.03), (0.06, 0.05, 0.06), 0.0, 0.9, 4.5, 0.012),
        Joint("lift", (0.03, 0.015, 0.05), Y, 0.18, (0.012, 0, 0.07), (0.03, 0.05, 0.13), -0.3, 0.6, 4.5, 0.012),
        Joint("elbow", (0.028, 0, 0.113), BACK, 0.17, (0.08, 0.002, 0.0), (0.14, 0.045, 0.03), -0.4, 0.7, 5.0, 0.010),
        Joint("flex", (0.135, 0, 0.005), BACK, 0.13, (0.04, 0, 0.002), (0.07, 0.04, 0.035), -0.5, 0.8, 6.0, 0.008),
        Joint("roll", (0.061, 0, 0), X, 0.14, (0.035, 0.006, -0.008), (0.09, 0.05, 0.03), 0.0, 1.2, 6.0, 0.007),
    ),
    (0.095, 0.0, 0.0),
)
ARM7 = Arm(
    "arm7",
    (
        Joint("a1", (0, 0, 0.16), Z, 1.75, (0, -0.02, 0.05), (0.11, 0.13, 0.16), 0.0, 0.7, 4.5, 0.20),
        Joint("a2", (0, 0, 0.13), Y, 1.60, (0.01, 0.02, 0.08), (0.11, 0.12, 0.20), 0.4, 0.45, 4.5, 0.20),
        Joint("a3", (0, 0, 0.17), Z, 1.35, (0.02, 0.01, 0.07), (0.10, 0.10, 0.16), 0.1, 0.7, 5.0, 0.10),
        Joint("a4", (0.05, 0, 0.14), BACK, 1.20, (-0.03, 0.015, 0.07), (0.10, 0.09, 0.18), -1.1, 0.5, 5.0, 0.10),
        Joint("a5", (-0.05, 0, 0.17), Z, 0.95, (0, 0.02, 0.06), (0.08, 0.09, 0.16), 0.0, 0.8, 6.0, 0.04),
        Joint("a6", (0, 0, 0.15), BACK, 0.70, (0.03, -0.004, 0.01), (0.10, 0.07, 0.08), -0.6, 0.7, 6.5, 0.03),
        Joint("a7", (0.08, 0, 0), X, 0.50, (0.04, 0.006, 0.0), (0.06, 0.09, 0.07), 0.0, 1.0, 7.0, 0.02),
    ),
    (0.09, 0.0, 0.0),
)
ARMS = {arm.name: arm for arm in (SERVO6, DESK5, ARM7)}


def urdf(arm: Arm) -> str:
    """The arm with its nominal masses as URDF text; its end effector is the link `tip`."""
    lines = [f'<robot name="{arm.name}">', '<link name="base"/>']
    parent = "base"
    for joint in arm.joints:
        xx, yy, zz = joint.inertia
        link, limit = f"{joint.name}_link", abs(joint.home) + 2 * joint.reach
        lines += [
            f'<link name="{link}"><inertial><origin xyz="{_text(joint.centre)}"/><mass value="{joint.mass}"/>'
            f'<inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}" ixy="0" ixz="0" iyz="0"/></inertial></link>',
            f'<joint name="{joint.name}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{_text(joint.at)}"/><axis xyz="{_text(joint.axis)}"/>'
            f'<limit lower="{-limit:.3f}" upper="{limit:.3f}" effort="1000" velocity="20"/></joint>',
        ]
        parent = link
    lines += [
        '<link name="tip"/>',
        f'<joint name="tip_joint" type="fixed"><parent link="{parent}"/><child link="tip"/>'
        f'<origin xyz="{_text(arm.tip)}"/></joint>',
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _text(numbers: tuple[float, float, float]) -> str:
    return " ".join(f"{number:g}" for number in numbers)
