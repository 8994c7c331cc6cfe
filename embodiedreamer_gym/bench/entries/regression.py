"""Residual torques of the nominal model, as sums of terms with one coefficient per joint.

A residual torque is the torque of the servo law for the logged command (or the logged effort, if there is no command)
minus the torque that the nominal model needs for the measured motion, both smoothed in the same way. A positive value
means that the robot resists more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from embodiedreamer_gym.bench.answers import NamedEffect
from embodiedreamer_gym.bench.task import Task
from embodiedreamer_gym.effects import Parameter, SignalLaw
from embodiedreamer_gym.recordings import Recording, smooth, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import run_sets

Array = np.ndarray
Columns = Mapping[str, Array]
SLOW = 0.02  # rad/s, over which dry friction changes sign
GAIN, VISCOUS, INERTIA, SINE = "torque", "v", "a", "sin q"
TERMS: dict[str, Callable[[Array, Array, Array, Array], Array]] = {  # of position, velocity, acceleration, torque
    GAIN: lambda q, v, a, torque: torque,
    VISCOUS: lambda q, v, a, torque: v,
    "sign v": lambda q, v, a, torque: np.tanh(v / SLOW),
    "1": lambda q, v, a, torque: np.ones_like(q),
    "q": lambda q, v, a, torque: q,
    SINE: lambda q, v, a, torque: np.sin(q),
    "v|v|": lambda q, v, a, torque: v * np.abs(v),
    INERTIA: lambda q, v, a, torque: a,
}
PARAMETERS = {  # term -> effect, parameter, sign in the sum; the other terms change the servo or the load
    "sign v": ("coulomb_friction", "torque", 1.0),
    "1": ("torque_bias", "torque", -1.0),
    "q": ("joint_spring", "stiffness", 1.0),
    "v|v|": ("quadratic_drag", "coefficient", 1.0),
    INERTIA: ("rotor_inertia", "inertia", 1.0),
}
POSITIVE = ("sign v", "v|v|", INERTIA, "q")
VISIBLE = 0.05  # share of a joint's torque (rms) above which a term counts


class SineLoad(SignalLaw):
    """A load that is proportional to the sine of the joint's angle."""

    name = "sine_load"
    stage = "load"
    parameters = (Parameter("torque", "N m", off=0.0, low=-100.0, high=100.0, typical=0.1, scale="torque"),)
    symptom = "the error grows with the sine of the joint's angle"
    reveals = "a slow sweep of one joint through its range"
    confused_with = ("payload",)

    @staticmethod
    def law(signal, joint, memory, p):
        """Subtract the load (B, n) in N m."""
        return signal - p.torque * np.sin(joint.position), memory


def left_over(task: Task, recordings: Sequence[Recording]) -> tuple[Array, dict[str, Array]]:
    """Residual torque (T, n) of recordings, and the columns (T, n) of the terms."""
    rests, parts = [], []
    for log in recordings:
        motion = smooth_motion(log)
        effort = log.effort if log.command is None else servo_torque(task.model, log, motion.velocity)
        if effort is None:
            continue
        bare = log.with_(command=None, effort=effort, effort_unit="N m")
        need = run_sets(task.model.with_(effects=()), [bare])[0].torque[0]
        torque = smooth(bare, smooth(bare, effort))
        rests.append(torque - need)
        parts.append([term(motion.position, motion.velocity, motion.acceleration, torque) for term in TERMS.values()])
    columns = {name: np.concatenate([part[k] for part in parts]) for k, name in enumerate(TERMS)}
    return np.concatenate(rests), columns


def servo_torque(model: RobotModel, log: Recording, velocity: Array) -> Array:
    """Torque (T, n) of the nominal servo for a recording's command."""
    return model.stiffness * (np.asarray(log.command) - log.position) - model.damping * velocity


def solve(rest: Array, columns: Columns, chosen: Array) -> Array:
    """Coefficients (terms, n) of the chosen terms (terms, n) bool, by ridge regression.

    Coefficients that must be positive but are negative are set to zero.
    """
    found = np.zeros(chosen.shape)
    for j in range(rest.shape[1]):
        use = chosen[:, j].copy()
        while use.any():
            matrix = np.stack(
                [column[:, j] for column, used in zip(columns.values(), use, strict=True) if used], axis=1
            )
            size = np.maximum(np.sqrt((matrix**2).mean(axis=0)), 1e-12)
            scaled = matrix / size
            values = (
                np.linalg.solve(scaled.T @ scaled + 1e-3 * len(rest) * np.eye(len(size)), scaled.T @ rest[:, j]) / size
            )
            names = [name for name, used in zip(columns, use, strict=True) if used]
            negative = [name in POSITIVE and value < 0 for name, value in zip(names, values, strict=True)]
            if not any(negative):
                found[use, j] = values
                break
            use[np.flatnonzero(use)[negative]] = False
    return found


def explained(columns: Columns, coefficients: Array) -> Array:
    """The sum of the terms (T, n)."""
    return sum((c * column for c, column in zip(coefficients, columns.values(), strict=True)), np.zeros(1))


def shares(columns: Columns, coefficients: Array) -> Array:
    """Rms (terms, n) of each term relative to the joint's torque."""
    size = np.sqrt((columns[GAIN] ** 2).mean(axis=0))
    rms = np.stack([np.sqrt((column**2).mean(axis=0)) for column in columns.values()])
    return np.abs(coefficients) * rms / size


def effects_of(task: Task, columns: Columns, coefficients: Array) -> tuple[NamedEffect, ...]:
    """The effects of the terms whose share is visible, with their values on the joints where it is visible."""
    part, found = shares(columns, coefficients), []
    for k, name in enumerate(columns):
        joints = np.flatnonzero(part[k] >= VISIBLE)
        if name in PARAMETERS and len(joints):
            effect, parameter, sign = PARAMETERS[name]
            values = {task.model.joints[j]: {"value": float(sign * coefficients[k, j])} for j in joints}
            found.append(NamedEffect(effect, None, tuple(values), {parameter: values}))
    return tuple(found)


def predictions(task: Task, columns: Columns, coefficients: Array) -> dict[str, Array]:
    """Predictions of the nominal model with the terms as effects; a gain scales the servo or the logged effort."""
    value = dict(zip(columns, coefficients, strict=True))
    gain = np.clip(1.0 - value[GAIN], 0.2, 5.0)
    model = task.model.with_(
        viscous_friction=np.maximum(task.model.viscous_friction + value[VISCOUS], 0.0),
        rotor_inertia=np.maximum(task.model.rotor_inertia + value[INERTIA], 0.0),
    )
    for name, (effect, parameter, sign) in PARAMETERS.items():
        if name != INERTIA and value[name].any():
            model = _with(model.with_effect(effect), f"{effect}.{parameter}", sign * value[name])
    if value[SINE].any():
        model = _with(model.with_effect(SineLoad), "sine_load.torque", value[SINE])
    if task.signal == "effort":
        return {name: run / gain for name, run in task.predictions(model).items()}
    return task.predictions(model.with_(stiffness=model.stiffness * gain, damping=model.damping * gain))


def _with(model: RobotModel, group: str, values: Array) -> RobotModel:
    return model.with_values({group: dict(zip(model.joints, values.tolist(), strict=True))})
