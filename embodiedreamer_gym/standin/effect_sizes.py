"""Draws the sizes of hidden effects and the joints that they act on.

Sizes are drawn log-uniformly between the bounds in SIZES. Some are relative to the fault-free arm in the training
motions: "peak" is its highest torque per joint, "load" the same but at least the servo's torque at 0.03 rad, "soft" the
reciprocal of "load", "top" its highest speed, "top_acceleration" that times ten per second, "stiffness" and "rotor" are
the servo's, and "mass" is the mass of all moving links. Delay, low-pass and rate limit act on all joints alike. Effects
that only a heavy link shows (BY_GRAVITY) act on joints with a gravity load. Other effects per joint act on one joint,
on the half nearer to the base, or on all. A "shape" does not grow with the strength.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.motions import Motion, Span
from embodiedreamer_gym.standin.firmware import PARAMETERS
from embodiedreamer_gym.standin.robot import StandIn

Array = np.ndarray

SIZES: dict[str, dict[str, tuple[float, float, str]]] = {
    "command_delay": {"seconds": (0.01, 0.05, "")},
    "command_lowpass": {"time_constant": (0.01, 0.05, "")},
    "command_rate_limit": {"rate": (0.25, 0.7, "top")},
    "servo_deadzone": {"width": (0.004, 0.02, "")},
    "torque_saturation": {"limit": (0.45, 0.8, "peak")},
    "voltage_limit": {
        "forward": (0.3, 0.7, "top"),
        "backward": (0.3, 0.7, "top"),
        "stall_torque": (1.5, 4.0, "peak shape"),
    },
    "coulomb_friction": {"torque": (0.04, 0.16, "load")},
    "stribeck_friction": {
        "sliding": (0.02, 0.08, "load"),
        "extra_static": (0.05, 0.2, "load"),
        "speed": (0.05, 0.2, "shape"),
    },
    "load_friction": {"coefficient": (0.08, 0.3, "")},
    "direction_dependent_friction": {"forward": (0.06, 0.2, "load"), "backward": (0.01, 0.04, "load")},
    "torque_bias": {"torque": (0.05, 0.2, "load")},
    "joint_spring": {"stiffness": (0.03, 0.12, "stiffness"), "angle": (0.1, 0.5, "shape")},
    "payload": {"mass": (0.03, 0.12, "mass")},
    "base_tilt": {"roll": (0.03, 0.12, ""), "pitch": (0.03, 0.12, "")},
    "encoder_offset": {"angle": (0.03, 0.12, "")},
    "torque_constant": {"gain": (1.5, 4.0, "")},
    "torque_fade": {"loss": (0.35, 0.65, ""), "time": (1.5, 6.0, "shape")},
    "hysteresis": {"torque": (0.06, 0.2, "load"), "travel": (0.01, 0.06, "shape")},
    "quadratic_drag": {"coefficient": (0.15, 0.6, "drag")},
    "torque_ripple": {
        "amplitude": (0.05, 0.15, "load"),
        "frequency": (6, 24, "shape"),
        "phase": (0.1, 6.2, "shape"),
    },
    "joint_elasticity": {"compliance": (0.02, 0.08, "soft"), "settling": (0.001, 0.005, "shape")},
    "backlash": {"gap": (0.02, 0.08, "")},
    "rotor_inertia": {"inertia": (4.0, 12.0, "rotor")},
    "timestamp_jitter": {"seconds": (0.002, 0.004, "")},
    "profile": {"acceleration": (0.25, 0.6, "top_acceleration"), "speed": (0.5, 1.5, "top shape")},
    "lookahead": {"seconds": (0.03, 0.1, ""), "inverse_gain": (0.15, 0.6, "shape")},
    "derivative_on_error": {"share": (0.5, 1.0, "")},
    "friction_compensation": {"dry": (0.05, 0.2, "load"), "viscous": (0.02, 0.1, "drag_line")},
    "gravity_compensation": {"share": (0.2, 0.9, "")},
    "integral_action": {"rate": (0.5, 4.0, "")},
    "velocity_cascade": {"rate": (1.0, 8.0, ""), "speed": (0.4, 1.2, "top shape")},
    "pwm_deadband": {"level": (0.05, 0.2, "load"), "start": (0.02, 0.1, "load")},
    "supply_sag": {"sag": (0.1, 0.4, "soft")},
}
SUPPLY = ("supply_sag",)
FIRMWARE = tuple(name for name in PARAMETERS if name not in SUPPLY)
FACTORS = ("command_rate_limit", "torque_saturation", "voltage_limit", "torque_constant", "profile")  # size ** strength
MOST = {
    "torque_fade": {"loss": 0.9},
    "derivative_on_error": {"share": 1.5},
    "gravity_compensation": {"share": 1.2},
    "timestamp_jitter": {"seconds": 0.02},
}
PER_ARM = ("payload", "base_tilt", "timestamp_jitter")
SAME_FOR_ALL = ("command_delay", "command_lowpass", "command_rate_limit", "lookahead")
BY_GRAVITY = ("encoder_offset", "gravity_compensation", "torque_fade", "joint_elasticity")
EITHER_SIGN = ("torque_bias", "encoder_offset", "base_tilt")
STRENGTHS = {"faint": 0.3, "plain": 1.0, "strong": 2.5}


def strength_of(strength: str | float) -> float:
    """The factor of a strength, which is given as a name or a positive number.

    Raises: EffectError for another name or number.
    """
    if isinstance(strength, str):
        if strength not in STRENGTHS:
            raise EffectError(f"there is no strength '{strength}'; give a number or one of {', '.join(STRENGTHS)}.")
        return STRENGTHS[strength]
    if not 0 < strength < np.inf:
        raise EffectError(f"strength is {strength:g}; give a number above 0 or one of {', '.join(STRENGTHS)}.")
    return float(strength)


def draw_values(
    effect: str,
    nominal: StandIn,
    motions: Sequence[Motion],
    span: Span,
    rng: np.random.Generator,
    strength: float,
    joints: list[int],
    arms: list[int],
) -> dict[str, Array]:
    """Values of the effect's parameters (n,) or (arms,); joints, arms: numbers of those on which it may act."""
    if effect not in SIZES:
        raise EffectError(f"there are no cases of '{effect}'; give one of {', '.join(SIZES)}.")
    if effect in PER_ARM:
        where, size = arms, np.ones(len(nominal.end_effectors))
    else:
        where, size = _choose(effect, nominal, span, rng, joints), np.ones(len(nominal.joints))
    scales = _scales(nominal, motions)
    values: dict[str, Array] = {}
    for name, (low, high, kind) in SIZES[effect].items():
        share = np.exp(rng.uniform(np.log(low), np.log(high), len(size)))
        if effect in SAME_FOR_ALL:
            share[:] = share[0]
        if "shape" not in kind:
            share = share ** min(strength, 1.5) if effect in FACTORS else share * strength
            share = np.minimum(share, MOST.get(effect, {}).get(name, np.inf))
        if effect in EITHER_SIGN:
            share *= rng.choice([-1.0, 1.0], len(size))
        whole = share * scales.get(kind.removesuffix("shape").strip(), size)
        values[name] = np.where(np.isin(np.arange(len(size)), where), whole, 0.0)
    return _adjust(effect, values, scales, span, rng)


def _adjust(
    effect: str, values: dict[str, Array], scales: Mapping[str, Array], span: Span, rng: np.random.Generator
) -> dict[str, Array]:
    """Adjusted values: torque limits that can hold the arm, springs at rest near home, either direction the harder."""
    for name in {"limit", "stall_torque"} & set(values):
        enough = np.maximum(values[name], 1.2 * scales["static"])
        values[name] = np.where(values[name] > 0, enough, 0.0)
    if effect == "command_rate_limit":
        on = values["rate"] > 0
        values["rate"] = np.where(on, np.median(values["rate"][on]), 0.0)
    if effect == "joint_spring":
        values["angle"] = span.centre + values["angle"] * rng.choice([-1.0, 1.0], len(span.centre))
        values["angle"] *= values["stiffness"] > 0
    if effect == "direction_dependent_friction" and rng.random() < 0.5:
        values = {"forward": values["backward"], "backward": values["forward"]}
    if effect == "torque_ripple":
        values["frequency"] = np.round(values["frequency"])
    return values


def _choose(effect: str, nominal: StandIn, span: Span, rng: np.random.Generator, joints: list[int]) -> list[int]:
    """Numbers of the joints that the effect acts on."""
    if effect in SAME_FOR_ALL:
        return joints
    joints = [j for j in joints if nominal.units[j] == "rad"]
    if effect in BY_GRAVITY:
        step = 0.05 * np.eye(len(nominal.joints))
        change = nominal.gravity_torque(span.centre + step) - nominal.gravity_torque(span.centre - step)
        slope = np.abs(np.diag(change)) / 0.1 / nominal.true["stiffness"]
        joints = [j for j in joints if slope[j] >= 0.3 * slope[joints].max()]
    draw = rng.random()
    if draw < 0.45:
        return [int(rng.choice(joints))]
    return joints[: (len(joints) + 1) // 2] if draw < 0.75 else joints


def _scales(nominal: StandIn, motions: Sequence[Motion]) -> dict[str, Array]:
    """Reference values (n,) of the relative SIZES, from the fault-free arm in the motions."""
    runs = [nominal.run(motion, motion.duration) for motion in motions]
    position, speed, torque = (np.concatenate([run[i][::10] for run in runs]) for i in (1, 2, 3))
    peak, top = np.abs(torque).max(0), np.abs(speed).max(0)
    return {
        "peak": peak,
        "load": np.maximum(peak, 0.03 * nominal.true["stiffness"]),
        "top": top,
        "top_acceleration": 10.0 * top,
        "drag": peak / top**2,
        "drag_line": peak / top,
        "static": np.abs(nominal.gravity_torque(position[::20])).max(0),
        "stiffness": nominal.true["stiffness"],
        "rotor": nominal.true["rotor_inertia"],
        "soft": 1.0 / np.maximum(peak, 0.03 * nominal.true["stiffness"]),
        "mass": np.array(nominal.moving_mass),
    }
