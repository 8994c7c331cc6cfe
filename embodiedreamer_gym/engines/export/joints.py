"""What a calibrated model says of its joints, as numbers that file formats have places for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.robot import RobotModel

POWERS = {  # of the stroke, by which numbers of a recorded unit become those of the URDF's
    "stiffness": -2, "damping": -2, "rotor_inertia": -2, "viscous_friction": -2, "spring": -2, "dry_friction": -1, "bristle": -1,
    "static": -1, "bias": -1, "ripple": -1, "limit": -1, "drag": -3, "rate": 1, "speed": 1, "offset": 1, "travel": 1,
    "stribeck_speed": 1, "ripple_frequency": -1,
}  # fmt: skip


@dataclass
class Joints:
    """Numbers (n,) of the driven joints, to be changed in place by the effects.

    stiffness, damping, rotor_inertia, viscous_friction: as in a robot model, the first two with the drive's gain;
    dry_friction: N m, the same in both directions; drag: N m s^2/rad^2; bias: constant torque, N m;
    bristle, static, stribeck_speed, travel: dry friction that gives way over a travel, rad, its sliding and its static level,
    N m, and the speed at which it has fallen between them, rad/s;
    ripple, ripple_frequency, ripple_phase: a torque A sin(N q + phase), N m, 1/rad and rad;
    spring, spring_angle: N m/rad and rad; limit: highest torque of the drive, N m; speed: the highest, rad/s;
    delay, lowpass: of the command, s; rate: its highest slope, rad/s; offset: of the encoder, rad.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    rotor_inertia: np.ndarray
    viscous_friction: np.ndarray
    dry_friction: np.ndarray
    drag: np.ndarray
    bias: np.ndarray
    bristle: np.ndarray
    static: np.ndarray
    stribeck_speed: np.ndarray
    travel: np.ndarray
    ripple: np.ndarray
    ripple_frequency: np.ndarray
    ripple_phase: np.ndarray
    spring: np.ndarray
    spring_angle: np.ndarray
    limit: np.ndarray
    speed: np.ndarray
    delay: np.ndarray
    lowpass: np.ndarray
    rate: np.ndarray
    offset: np.ndarray

    def of_urdf(self, gain: np.ndarray, zero: np.ndarray) -> Joints:
        """The same numbers where the joint's value is gain * recorded + zero, each (n,)."""
        size = {name: getattr(self, name) * np.abs(gain) ** power for name, power in POWERS.items()}
        for name in ("bias", "offset", "ripple"):
            size[name] = size[name] * np.sign(gain)
        phase = self.ripple_phase - self.ripple_frequency * zero / gain
        frequency = size["ripple_frequency"] * np.sign(gain)
        return replace(
            self,
            **size | {"ripple_frequency": frequency},
            ripple_phase=phase,
            spring_angle=gain * self.spring_angle + zero,
        )


def plain_joints(model: RobotModel) -> Joints:
    """The joints of a model without its effects."""
    names = [name for name in Joints.__dataclass_fields__ if not hasattr(model, name)]
    far = {"limit", "speed", "rate"}
    return Joints(
        **{name: getattr(model, name).copy() for name in ("stiffness", "damping", "rotor_inertia", "viscous_friction")},
        **{name: np.full(model.n, np.inf if name in far else 0.0) for name in names},
    )


def scales(model: RobotModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Body that each driven joint moves, and the joint's value as gain * recorded + zero, each (n,)."""
    tree = model.tree
    bodies = np.array([tree.joint_names.index(name) for name in model.joints])
    return bodies, tree.gain[bodies], tree.offset[bodies]
