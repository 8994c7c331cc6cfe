"""MuJoCo's toolbox, `mujoco.sysid`, with a manual list of structures; the best one on held-out recordings is named.

It simulates forward from commands, so it gives no answer for recordings without commands.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.bench.answers import NamedEffect
from embodiedreamer_gym.bench.entries.finding import Finding
from embodiedreamer_gym.bench.task import Task
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.errors import MissingExtraError
from embodiedreamer_gym.recordings import Recording

SECONDS = 3.0  # s of each recording used in a fit
ITERATIONS = 6
FACTORS = (0.1, 10.0)  # bounds of the factors on stiffness, damping and viscous friction
LOWER = 0.9  # multiple of the error without a structure that a structure must reach to be named


@dataclass(frozen=True)
class Structure:
    """One effect: parameter, bounds, function that writes its value, and whether it is one number for all joints."""

    effect: str
    parameter: str
    low: float
    high: float
    write: Callable[[Any, list[str], np.ndarray], None]
    common: bool = False


def _friction(spec: Any, joints: list[str], value: np.ndarray) -> None:
    for name, one in zip(joints, value, strict=True):
        spec.joint(name).frictionloss = one


def _bias(spec: Any, joints: list[str], value: np.ndarray) -> None:
    for name, one in zip(joints, value, strict=True):
        spec.actuator(name).biasprm[0] = one


def _spring(spec: Any, joints: list[str], value: np.ndarray) -> None:
    for name, one in zip(joints, value, strict=True):
        spec.joint(name).stiffness[0] = one


def _drag(spec: Any, joints: list[str], value: np.ndarray) -> None:
    for name, one in zip(joints, value, strict=True):
        spec.joint(name).damping[1] = one


def _rotor(spec: Any, joints: list[str], value: np.ndarray) -> None:
    for name, one in zip(joints, value, strict=True):
        spec.joint(name).armature += one


def _payload(spec: Any, joints: list[str], value: np.ndarray) -> None:
    body = spec.body("tip") or spec.joint(joints[-1]).parent
    body.mass += value[0]


def _lowpass(spec: Any, joints: list[str], value: np.ndarray) -> None:
    for name in joints:
        spec.actuator(name).dynprm[0] = value[0]


STRUCTURES = (
    Structure("coulomb_friction", "torque", 0.0, 10.0, _friction),
    Structure("torque_bias", "torque", -20.0, 20.0, _bias),
    Structure("joint_spring", "stiffness", 0.0, 100.0, _spring),
    Structure("quadratic_drag", "coefficient", 0.0, 10.0, _drag),
    Structure("rotor_inertia", "inertia", 0.0, 1.0, _rotor),
    Structure("payload", "mass", 0.0, 3.0, _payload, common=True),
    Structure("command_lowpass", "time_constant", 1e-3, 0.2, _lowpass, common=True),
)


def answer(task: Task) -> Finding:
    """Fit gains and damping, then each structure in addition; name the best if the held-out error falls by 10 %."""
    sysid = _toolbox()
    if task.signal == "effort":
        return Finding(None)
    plain = _Fit(task, sysid, None, np.ones(3 * task.model.n))
    best, error = plain, LOWER * plain.error(task.test)
    for structure in STRUCTURES:
        one = _Fit(task, sysid, structure, plain.values)
        if (now := one.error(task.test)) <= error:
            best, error = one, now
    effects = () if best.structure is None else (best.effect(best.structure, task.model.arms[0]),)
    predictions = {motion.name: best.run(motion) for motion in task.predict}
    return Finding("missing" if effects else "nothing_missing", effects, predictions)


class _Fit:
    """The nominal MJCF fitted to the training recordings.

    Parameters are factors (3 n,) on stiffness, damping and viscous friction, and those of one structure.
    """

    def __init__(self, task: Task, sysid: Any, structure: Structure | None, start: np.ndarray) -> None:
        self.structure, self.sysid, self.joints = structure, sysid, list(task.model.joints)
        self.spec = _specification(task, structure)
        self.model = self.spec.compile()
        parameters = sysid.ParameterDict()
        parameters.add(
            sysid.Parameter("servo", start, np.full(start.shape, FACTORS[0]), np.full(start.shape, FACTORS[1]))
        )
        if structure is not None:
            size = 1 if structure.common else len(self.joints)
            first = np.full(
                size, structure.low + 1e-2 * (min(structure.high, 5.0) - structure.low) if structure.low >= 0 else 0.0
            )
            parameters.add(
                sysid.Parameter("effect", first, np.full(size, structure.low), np.full(size, structure.high))
            )
        logs = [_head(log) for log in task.train]
        sequences = sysid.ModelSequences(
            "arm", self.spec, [log.name for log in logs], [self._state(log) for log in logs],
            [self._series(log.time, log.command, True) for log in logs],
            [self._series(log.time, log.position) for log in logs],
        )  # fmt: skip
        residual = sysid.build_residual_fn(models_sequences=[sequences], build_model=self._build, n_threads=1)
        parameters.move_off_bounds()
        with redirect_stdout(io.StringIO()):  # the solver prints even if `verbose` is false
            self.fitted, result = sysid.optimize(parameters, residual, max_iters=ITERATIONS, verbose=False)
        parts, _, _ = residual(result.x, self.fitted)
        _, self.half = sysid.calculate_intervals([np.ravel(part) for part in parts], np.asarray(result.jac))
        self.values = self.fitted["servo"].value
        self.best = self._build(self.fitted, self.spec)

    def _build(self, parameters: Any, spec: Any) -> Any:
        spec = spec.copy()
        stiff, damp, viscous = np.split(parameters["servo"].value, 3)
        for k, name in enumerate(self.joints):
            self.sysid.apply_pgain(spec, name, spec.actuator(name).gainprm[0] * stiff[k])
            spec.actuator(name).biasprm[2] *= damp[k]
            spec.joint(name).damping = spec.joint(name).damping * viscous[k]
        if self.structure is not None:
            self.structure.write(spec, self.joints, parameters["effect"].value)
        return spec.compile()

    def _state(self, log: Recording) -> np.ndarray:
        act = log.command[0] if self.model.na and log.command is not None else None
        still = max(int(np.searchsorted(log.time - log.time[0], 0.05, side="right")), 1)
        return self.sysid.create_initial_state(self.model, log.position[:still].mean(axis=0), None, act)

    def _series(self, time: np.ndarray, values: np.ndarray | None, control: bool = False) -> Any:
        kind = self.sysid.TimeSeries
        make = kind.from_control_names if control else kind.from_names
        return make(time - time[0], np.asarray(values), self.model)

    def run(self, log: Recording) -> np.ndarray:
        """Position (T, n) of the fitted model at a recording's times."""
        control = self._series(log.time, log.command, True).resample(target_dt=self.best.opt.timestep)
        data = [mujoco.MjData(self.best)]
        made = self.sysid.sysid_rollout([self.best], data, [control], [self._state(log)])[0].sensordata
        own, seen = np.asarray(made.times), np.asarray(made.data)
        return np.stack([np.interp(log.time - log.time[0], own, column) for column in seen.T], axis=1)

    def error(self, logs: Sequence[Recording]) -> float:
        """Mean over joints of the root mean square error, rad."""
        rests = np.concatenate([self.run(log) - log.position for log in logs])
        return float(np.sqrt((rests**2).mean(axis=0)).mean())

    def effect(self, structure: Structure, tip: str) -> NamedEffect:
        """The structure as an effect: on the joints whose 95 % interval excludes zero, or on the end effector."""
        values, half = self.fitted["effect"].value, self.half[-self.fitted["effect"].size :]
        places = [tip] if structure.effect == "payload" else self.joints
        pairs = list(zip(np.broadcast_to(values, len(places)), np.broadcast_to(half, len(places)), strict=True))
        rows = {place: {"value": float(v)} | ({"low": float(v - h), "high": float(v + h)} if np.isfinite(h) else {})
                for place, (v, h) in zip(places, pairs, strict=True)}  # fmt: skip
        away = tuple(place for place, (v, h) in zip(places, pairs, strict=True) if abs(v) > h) or tuple(places)
        return NamedEffect(structure.effect, None, away, {structure.parameter: {place: rows[place] for place in away}})


def _specification(task: Task, structure: Structure | None) -> Any:
    """The case's MJCF with a position sensor at each joint, and filters before the servos if the structure is one."""
    spec = mujoco.MjSpec.from_file(str(task.folder / "arm.xml"))
    for name in task.model.joints:
        spec.add_sensor(
            name=f"{name}_pos", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name
        )
        if structure is not None and structure.effect == "command_lowpass":
            spec.actuator(name).dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            spec.actuator(name).dynprm[0] = 0.01
    return spec


def _head(log: Recording) -> Recording:
    """The first SECONDS of a recording."""
    part = slice(0, max(int(np.searchsorted(log.time - log.time[0], SECONDS, side="right")), 10))
    return Recording(
        log.name, log.joints, log.time[part], log.position[part], None if log.command is None else log.command[part]
    )


def _toolbox() -> Any:
    try:
        from mujoco import sysid

        if hasattr(sysid, "ParameterDict"):
            return sysid
        reason = None
    except ImportError as error:
        reason = error
    raise MissingExtraError(
        "the entry mujoco-sysid needs mujoco.sysid, which is not completely installed; run: pip install 'embodiedreamer-gym[bench]'"
    ) from reason
