"""Hidden effects of the stand-in, which a model has to identify; they do not share code with the package's effects.

Values are per joint (n,) or one number for all; base_tilt and payload are per arm. Units are those of the
recording: rad, N m, s, kg (a normalised gripper's stroke counts as 1). Zero means absent, also for limits.
A log's effort is the torque that the drive requests; errors of the motor's torque, friction, springs, bias and ripple
are not part of it.

| effect | implementation in MuJoCo |
|---|---|
| coulomb, stribeck, load_friction | `dof_frictionloss`, set before each step from speed, drive and load |
| direction_dependent_friction | `dof_frictionloss` at the mean of both directions, half their difference as a torque |
| hysteresis | generalised force of a bristle (LuGre without damping), its bend integrated implicitly |
| torque_bias, torque_ripple, quadratic_drag | generalised force on the joint |
| joint_spring | joint stiffness |
| torque_constant, torque_fade | gains and force range of the actuator; the fade begins with the motion |
| joint_elasticity, backlash | the motor is a separate body, a tendon's spring or limits couple it to the joint |
| rotor_inertia | `dof_armature` |
| torque_saturation | force range of the actuator |
| voltage_limit | torque-speed line from `stall_torque` at rest; without one, 100 times the servo's damping |
| servo_deadzone, encoder_offset | the set point the actuator sees |
| command_delay, command_lowpass, command_rate_limit, profile, lookahead | the command at every step, in this order |
| gravity_compensation, integral_action and other firmware torques, supply_sag | shift of the set point, see `firmware`
| | payload, base_tilt | a ball welded to the end effector; the arm rotated at its root |
| timestamp_jitter | not in MuJoCo: the log has one clock, with the jitter of its worst arm |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.signal import lfilter

from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.standin.firmware import PARAMETERS, SecondOrder, trapezoid

Array = np.ndarray
NEVER = 1e6  # a speed that no joint reaches
STEEP = 100.0  # slope of a torque-speed line without a stall torque, in multiples of the servo's damping

# parameter -> (per "joint" or "arm", power of the gripper's stroke that converts it to URDF units)
EFFECTS: dict[str, dict[str, tuple[str, int]]] = {
    "command_delay": {"seconds": ("joint", 0)},
    "command_lowpass": {"time_constant": ("joint", 0)},
    "command_rate_limit": {"rate": ("joint", 1), "tick": ("joint", 0), "step": ("joint", 1)},
    "servo_deadzone": {"width": ("joint", 1), "jump": ("joint", 0)},
    "torque_saturation": {"limit": ("joint", -1)},
    "voltage_limit": {"forward": ("joint", 1), "backward": ("joint", 1), "stall_torque": ("joint", -1)},
    "torque_constant": {"gain": ("joint", 0)},
    "torque_fade": {"loss": ("joint", 0), "time": ("joint", 0)},
    "coulomb_friction": {"torque": ("joint", -1)},
    "stribeck_friction": {"sliding": ("joint", -1), "extra_static": ("joint", -1), "speed": ("joint", 1)},
    "load_friction": {
        "coefficient": ("joint", 0),
        "external": ("joint", 0),
        "static": ("joint", 0),
        "speed": ("joint", 1),
    },
    "direction_dependent_friction": {"forward": ("joint", -1), "backward": ("joint", -1)},
    "hysteresis": {"torque": ("joint", -1), "travel": ("joint", 1)},
    "quadratic_drag": {"coefficient": ("joint", -3)},
    "torque_bias": {"torque": ("joint", -1)},
    "torque_ripple": {"amplitude": ("joint", -1), "frequency": ("joint", -1), "phase": ("joint", 0)},
    "joint_spring": {"stiffness": ("joint", -2), "angle": ("joint", 1)},
    "joint_elasticity": {"compliance": ("joint", 2), "settling": ("joint", 0)},
    "backlash": {"gap": ("joint", 1)},
    "rotor_inertia": {"inertia": ("joint", -2)},
    "payload": {"mass": ("arm", 0), "x": ("arm", 0), "y": ("arm", 0), "z": ("arm", 0)},
    "base_tilt": {"roll": ("arm", 0), "pitch": ("arm", 0)},
    "encoder_offset": {"angle": ("joint", 1)},
    "timestamp_jitter": {"seconds": ("arm", 0)},
    **PARAMETERS,
}


class Hidden:
    """Values of the hidden effects in URDF units: `get(effect, parameter)` is (n,) or (arms,)."""

    def __init__(self, effects: Mapping[str, Mapping[str, Any]], stroke: Array, arms: int) -> None:
        self._values: dict[tuple[str, str], Array] = {}
        self._stroke, self._arms = stroke, arms
        for effect, parameters in effects.items():
            if effect not in EFFECTS:
                raise EffectError(f"the stand-in has no effect '{effect}'; it has {', '.join(EFFECTS)}.")
            for name, value in parameters.items():
                if name not in EFFECTS[effect]:
                    raise EffectError(f"{effect} has no parameter '{name}'; it has {', '.join(EFFECTS[effect])}.")
                self._values[effect, name] = self._spread(effect, name, value)

    def get(self, effect: str, parameter: str) -> Array:
        """Values of one parameter; zeros if it was not given."""
        blank = np.zeros(self._arms if EFFECTS[effect][parameter][0] == "arm" else len(self._stroke))
        return self._values.get((effect, parameter), blank)

    def _spread(self, effect: str, name: str, value: Any) -> Array:
        per, power = EFFECTS[effect][name]
        size = self._arms if per == "arm" else len(self._stroke)
        given = np.asarray(value, float)
        if given.shape not in ((), (size,)) or not np.isfinite(given).all():
            raise EffectError(
                f"{effect}.{name} must be a finite number or {size} of them, one per {per}, not {value!r}."
            )
        return np.full(size, given) * (self._stroke**power if per == "joint" else 1.0)


def shape_command(setpoint: Callable[[Array], Array], hidden: Hidden, steps: int, dt: float) -> Array:
    """Set points (steps, n) that reach the servo at 0, dt, ...; before time 0, the first one is held."""
    return CommandPath(hidden, dt).shape(setpoint, steps)


class CommandPath:
    """Effects on commands on their way to the servo; a motion may be processed in several pieces."""

    def __init__(self, hidden: Hidden, dt: float) -> None:
        self._hidden, self._dt, self._steps = hidden, dt, 0
        self._filters: dict[int, tuple[float, Array]] = {}
        self._reached: dict[int, tuple[int, float]] = {}
        self._profiles: dict[int, tuple[float, float]] = {}
        self._ahead: dict[int, SecondOrder] = {}

    def shape(self, setpoint: Callable[[Array], Array], steps: int) -> Array:
        """The next set points (steps, n) that reach the servo; setpoint: commands known by then, (k,) s -> (k, n)."""
        hidden, dt = self._hidden, self._dt
        time = (self._steps + np.arange(steps)) * dt
        self._steps += steps
        delay = hidden.get("command_delay", "seconds")
        command = setpoint(time)
        for seconds in np.unique(delay[delay > 0]):
            late = delay == seconds
            command[:, late] = setpoint(np.maximum(time - seconds, 0.0))[:, late]
        constant = hidden.get("command_lowpass", "time_constant")
        for j in np.flatnonzero(constant > 0).tolist():
            command[:, j] = self._first_order(j, command[:, j], constant[j])
        rate, tick, step = (hidden.get("command_rate_limit", p) for p in ("rate", "tick", "step"))
        for j in np.flatnonzero((rate > 0) | ((tick > 0) & (step > 0))).tolist():
            if tick[j] > 0:
                command[:, j] = self._ramp(j, command[:, j], np.floor(time / tick[j] + 1e-9).astype(int), step[j])
            else:
                command[:, j] = self._ramp(j, command[:, j], np.arange(steps) + self._steps, rate[j] * dt)
        acceleration, speed = (hidden.get("profile", p) for p in ("acceleration", "speed"))
        for j in np.flatnonzero(acceleration > 0).tolist():
            state = self._profiles.get(j, (float(command[0, j]), 0.0))
            moved = trapezoid(command[:, j], state, acceleration[j], speed[j], dt)
            command[:, j], self._profiles[j] = moved[:, 0], (moved[-1, 0], moved[-1, 1])
        ahead, inverse_gain = (hidden.get("lookahead", p) for p in ("seconds", "inverse_gain"))
        for j in np.flatnonzero(ahead > 0).tolist():
            given = ahead[j], inverse_gain[j], dt, float(command[0, j])
            command[:, j] = self._ahead.setdefault(j, SecondOrder(*given))(command[:, j])
        return command

    def _first_order(self, j: int, signal: Array, constant: float) -> Array:
        """A signal (k,) after a first-order filter, exact for signals that are linear between steps."""
        decay = np.exp(-self._dt / constant)
        later = 1 - constant / self._dt * (1 - decay)
        rest, memory = self._filters.get(j, (signal[0], np.zeros(1)))
        filtered, memory = lfilter([later, 1 - decay - later], [1, -decay], signal - rest, zi=memory)
        self._filters[j] = rest, memory
        return filtered + rest

    def _ramp(self, j: int, signal: Array, slots: Array, most: float) -> Array:
        """A value (k,) that moves by at most `most` towards the signal (k,) whenever a new slot (k,) begins."""
        slot, value = self._reached.get(j, (-1, float(signal[0])))
        out = np.empty(len(signal))
        for k, (goal, now) in enumerate(zip(signal.tolist(), slots.tolist(), strict=True)):
            if now != slot:
                slot, value = now, value + min(max(goal - value, -most), most)
            out[k] = value
        self._reached[j] = slot, value
        return out


def friction_law(hidden: Hidden) -> tuple[Array, Callable[[Array, Array, Array], Array] | None]:
    """Constant friction level (n,); and, if it varies, the level as a function of speed, servo and outer torque."""
    forward = hidden.get("direction_dependent_friction", "forward")
    backward = hidden.get("direction_dependent_friction", "backward")
    level = hidden.get("coulomb_friction", "torque") + (forward + backward) / 2
    sliding, extra = (
        hidden.get("stribeck_friction", "sliding"),
        hidden.get("stribeck_friction", "extra_static"),
    )
    speed = hidden.get("stribeck_friction", "speed")
    share, outer_share, resting, fading = (
        hidden.get("load_friction", name) for name in ("coefficient", "external", "static", "speed")
    )
    if np.any((extra > 0) & (speed <= 0)):
        raise EffectError("stribeck_friction needs a speed above zero wherever extra_static is not zero.")
    if np.any((resting > 0) & (fading <= 0)):
        raise EffectError("load_friction needs a speed above zero wherever its static share is not zero.")
    level = level + sliding
    if not (extra.any() or share.any() or outer_share.any() or resting.any()):
        return level, None
    still = 1.0 / np.where(fading > 0, fading, 1.0)
    slowness = 1.0 / np.where(speed > 0, speed, 1.0)

    def varying(v: Array, torque: Array, outer: Array) -> Array:
        scaled, own = v * slowness, v * still
        gears = np.abs(share * torque - outer_share * outer) + resting * np.exp(-own * own) * np.abs(torque - outer)
        return level + extra * np.exp(-scaled * scaled) + gears

    return level, varying


def torque_speed_line(hidden: Hidden, damping: Array) -> tuple[Array, Array, Array, Array] | None:
    """Highest speed, its slope, lowest speed, its slope (n,); the torque is between the lines slope * (speed - v)."""
    forward, backward = (hidden.get("voltage_limit", side) for side in ("forward", "backward"))
    if not (forward.any() or backward.any()):
        return None
    stall = np.where((forward > 0) | (backward > 0), hidden.get("voltage_limit", "stall_torque"), 0.0)
    top, bottom = (np.where(speed > 0, speed, NEVER) for speed in (forward, backward))
    rise, fall = (np.where(stall > 0, stall / speed, STEEP * damping) for speed in (top, bottom))
    return top, rise, -bottom, fall


def gears(hidden: Hidden, joints: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """Compliance, settling time and gap of the joints whose gear has compliance or a gap."""
    rows = (hidden.get("joint_elasticity", "compliance"), hidden.get("joint_elasticity", "settling"),
            hidden.get("backlash", "gap"))  # fmt: skip
    numbers = zip(joints, *(row.tolist() for row in rows), strict=True)
    return {name: (give, settling, gap) for name, give, settling, gap in numbers if give > 0 or gap > 0}


def gear_damper(hidden: Hidden) -> Array:
    """Damping (n,) of the gears' springs, N m s/rad."""
    compliance, settling = (hidden.get("joint_elasticity", name) for name in ("compliance", "settling"))
    return np.where(compliance > 0, settling / np.where(compliance > 0, compliance, 1.0), 0.0)


def bristle_law(hidden: Hidden) -> Callable[[Array, Array, float], Array] | None:
    """Presliding friction: a function that integrates the bristles' bend (n,) rad, in place, and returns the torque.

    Its arguments are the bend, the speed v (n,) and a time step. dz/dt = v - |v| z / travel, with the torque
    level * z / travel (Canudas de Wit et al. 1995, without their damping).
    """
    level, travel = (hidden.get("hysteresis", name) for name in ("torque", "travel"))
    if not level.any():
        return None
    if np.any((level > 0) & (travel <= 0)):
        raise EffectError("hysteresis needs a travel above zero wherever its torque is not zero.")
    per_travel = 1.0 / np.where(travel > 0, travel, 1.0)

    def resist(bend: Array, v: Array, dt: float) -> Array:
        bend += dt * v
        bend /= 1.0 + dt * np.abs(v) * per_travel
        return level * per_travel * bend

    return resist


def drive_strength(hidden: Hidden) -> tuple[Array, Callable[[float], Array] | None]:
    """Share (n,) of its torque that the drive gives when cool; and, if it fades, the share as a function of time, s."""
    gain = hidden.get("torque_constant", "gain")
    strength = np.where(gain > 0, gain, 1.0)
    loss, time = (hidden.get("torque_fade", name) for name in ("loss", "time"))
    if np.any((loss > 0) & (time <= 0)):
        raise EffectError("torque_fade needs a time above zero wherever its loss is not zero.")
    rate = 1.0 / np.where(time > 0, time, 1.0)
    return strength, (lambda t: strength * (1 - loss * (1 - np.exp(-t * rate)))) if loss.any() else None
