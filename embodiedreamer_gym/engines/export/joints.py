"""Joint parameters of a calibrated model, as numbers for file formats."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.robot import RobotModel

POWERS = {  # of the stroke, which converts numbers in recorded units to URDF units
    **dict.fromkeys(("stiffness", "damping", "rotor_inertia", "viscous_friction", "spring"), -2),
    **dict.fromkeys(("dry_friction", "extra_static", "hysteresis", "ripple", "bias", "limit", "stall"), -1),
    **dict.fromkeys(("stribeck_speed", "travel", "rate", "forward", "backward", "offset"), 1),
    "drag": -3, "ripple_frequency": -1,
}  # fmt: skip
DRIVEN = ("stiffness", "damping", "limit", "stall")  # multiplied by the drive's gain
SIGNED = ("bias", "offset", "ripple", "ripple_frequency")  # their sign depends on the joint's direction


@dataclass
class Joints:
    """Numbers (n,) of the driven joints, to be changed in place by the effects.

    stiffness, damping, rotor_inertia, viscous_friction: as in a robot model;
    dry_friction: N m, the same in both directions; drag: N m s^2/rad^2; bias: constant torque, N m;
    extra_static, stribeck_speed: additional dry friction near standstill, N m, and the speed over which it falls,
    rad/s; hysteresis, travel: friction that builds up over a travel, N m and rad;
    ripple, ripple_frequency, ripple_phase: a torque A sin(N q + phase), N m, 1/rad and rad;
    spring, spring_angle: N m/rad and rad; gain: of the drive's torque, already applied to gains and limits by
    `of_urdf`; limit: highest torque of the drive, N m; stall, forward, backward: its torque at rest, N m, which falls
    to zero at these speeds, rad/s;
    delay, lowpass: of the command, s; rate: its highest slope, rad/s; offset: of the encoder, rad.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    rotor_inertia: np.ndarray
    viscous_friction: np.ndarray
    dry_friction: np.ndarray
    drag: np.ndarray
    bias: np.ndarray
    extra_static: np.ndarray
    stribeck_speed: np.ndarray
    hysteresis: np.ndarray
    travel: np.ndarray
    ripple: np.ndarray
    ripple_frequency: np.ndarray
    ripple_phase: np.ndarray
    spring: np.ndarray
    spring_angle: np.ndarray
    gain: np.ndarray
    limit: np.ndarray
    stall: np.ndarray
    forward: np.ndarray
    backward: np.ndarray
    delay: np.ndarray
    lowpass: np.ndarray
    rate: np.ndarray
    offset: np.ndarray

    def of_urdf(self, gain: np.ndarray, zero: np.ndarray) -> Joints:
        """The same numbers for joints whose URDF value is gain * recorded + zero, each (n,)."""
        driven = replace(self, **{name: getattr(self, name) * self.gain for name in DRIVEN})
        values = {name: getattr(driven, name) * np.abs(gain) ** power for name, power in POWERS.items()}
        values |= {name: values[name] * np.sign(gain) for name in SIGNED}
        phase = self.ripple_phase - values["ripple_frequency"] * zero
        return replace(self, **values, ripple_phase=phase, spring_angle=gain * self.spring_angle + zero)

    @property
    def fastest(self) -> np.ndarray:
        """Speed (n,) rad/s at which the drive's torque is zero, as harmonic mean of both directions; inf: never."""
        with np.errstate(divide="ignore"):
            speed = 2.0 / (1.0 / self.forward + 1.0 / self.backward)
        return np.where(np.isfinite(self.stall), speed, np.inf)


def plain_joints(model: RobotModel) -> Joints:
    """The joints of a model without its effects."""
    names = [name for name in Joints.__dataclass_fields__ if not hasattr(model, name)]
    begin = {"gain": 1.0, **dict.fromkeys(("limit", "stall", "forward", "backward", "rate"), np.inf)}
    return Joints(
        **{name: getattr(model, name).copy() for name in ("stiffness", "damping", "rotor_inertia", "viscous_friction")},
        **{name: np.full(model.n, begin.get(name, 0.0)) for name in names},
    )


def scales(model: RobotModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Body that each driven joint moves, and gain and zero of its value gain * recorded + zero, each (n,)."""
    tree = model.tree
    bodies = np.array([tree.joint_names.index(name) for name in model.joints])
    return bodies, tree.gain[bodies], tree.offset[bodies]
