"""The stand-in's engine: a MuJoCo plant with hidden effects, simulated from rest step by step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.standin.firmware import ServoFirmware
from embodiedreamer_gym.standin.hidden import (
    CommandPath,
    Hidden,
    bristle_law,
    drive_strength,
    friction_law,
    gear_damper,
    shape_command,
    torque_speed_line,
)
from embodiedreamer_gym.standin.plant import Plant, import_mujoco, rotation_quaternion, turned

Array = np.ndarray
CREEP = 2e-3  # rad/s, speed that still counts as rest


class Engine:
    """Plays set points on a plant; value in recorded units = (URDF value - zero) / stroke, each (n,).

    servo: stiffness, damping, rotor_inertia and viscous_friction (n,), per recorded unit.
    """

    def __init__(
        self,
        plant: Plant,
        hidden: Hidden,
        servo: Mapping[str, Array],
        zero: Array,
        stroke: Array,
        timestep: float,
        weigh: Callable[[Array], Array] | None = None,
    ) -> None:
        self._mujoco = import_mujoco()
        self._plant, self._hidden, self.timestep = plant, hidden, timestep
        self._zero, self._stroke = zero, stroke
        self._model, self._data = plant.model, self._mujoco.MjData(plant.model)
        self._kp, self._kd = servo["stiffness"] / stroke**2, servo["damping"] / stroke**2
        self._offset = hidden.get("encoder_offset", "angle")
        limit = hidden.get("torque_saturation", "limit")
        self._limit = np.where(limit > 0, limit, np.inf)
        self._line = torque_speed_line(hidden, self._kd)
        self._strength, self._fading = drive_strength(hidden)
        self._rotor = servo["rotor_inertia"] / stroke**2 + hidden.get("rotor_inertia", "inertia")
        self._viscous = servo["viscous_friction"] / stroke**2
        self._model.dof_damping[plant.motor_dof] = self._viscous
        self._set_servo(self._strength)
        self._bristle, self._bend = bristle_law(hidden), np.zeros(len(stroke))
        self._set_effects()
        self._firmware = ServoFirmware(hidden.get, self._kp, self._kd, weigh, timestep)
        self._rest: dict[bytes, tuple[Array, Array, Array]] = {}
        self._path = CommandPath(hidden, timestep)

    def _set_servo(self, strength: Array) -> None:
        """Set the actuators' gains and force ranges so that this share (n,) of their torque arrives."""
        self._share = strength
        model, kp, kd = self._model, strength * self._kp, strength * self._kd
        # Compensates for the half step of damping that the implicit integrator adds: a six-joint arm at 0.1 ms is
        # then within 0.001 mrad of one at 0.02 ms.
        model.dof_armature[self._plant.dof] = 0.0
        model.dof_armature[self._plant.motor_dof] = self._rotor - (kd + self._viscous) * self.timestep / 2
        model.actuator_gainprm[:, 0] = kp
        model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -kp, -kd
        limited, most = np.isfinite(self._limit), strength * self._limit
        model.actuator_forcerange[limited] = np.stack([-most, most], axis=-1)[limited]

    def _set_effects(self) -> None:
        model, at, dof, get = self._model, self._plant.position, self._plant.dof, self._hidden.get
        model.jnt_stiffness[model.dof_jntid[dof]] = get("joint_spring", "stiffness")
        model.qpos_spring[at] = self._zero + get("joint_spring", "angle")
        self._mujoco.mj_forward(model, self._data)
        tilts = zip(self._plant.arm_root, get("base_tilt", "roll"), get("base_tilt", "pitch"), strict=True)
        for body, roll, pitch in tilts:
            mount = self._data.xquat[model.body_parentid[body]]
            tilt = rotation_quaternion(roll, pitch)
            model.body_quat[body] = turned(mount * (1, -1, -1, -1), tilt, mount, model.body_quat[body])
        level, self._varying = friction_law(self._hidden)
        model.dof_frictionloss[dof] = level
        uneven = get("direction_dependent_friction", "backward") - get("direction_dependent_friction", "forward")
        self._constant_torque = get("torque_bias", "torque") + uneven / 2
        self._beside = get("torque_bias", "torque")  # torque on the joints besides drive, bodies, springs and friction
        self._mujoco.mj_setConst(model, self._data)

    def _laws(self, warming: bool) -> list[Callable[[], None]]:
        """Functions to call before each step; warming: whether the drives' fade has begun."""
        data, get = self._data, self._hidden.get
        q, ctrl, laws = data.qpos, data.ctrl, []
        if self._fading is not None and warming:
            fading = self._fading
            laws.append(lambda: self._set_servo(fading(data.time)))
        laws += self._torque_laws()
        if self._varying is not None:
            laws.append(self._friction_law(self._varying))
        width, jump, motor_at = *(get("servo_deadzone", p) for p in ("width", "jump")), self._plant.motor_position
        if width.any():

            def shrink_error() -> None:
                error = ctrl - q[motor_at]
                ignored = np.minimum(np.maximum(error, -width), width)
                ctrl[:] -= np.where(np.abs(error) > width, 1.0 - jump, 1.0) * ignored

            laws.append(shrink_error)
        if self._firmware.counts:
            shift, motor = self._firmware.shift, self._plant.motor_dof

            def add_torque() -> None:
                ctrl[:] += shift(self._wanted, ctrl, q[motor_at], data.qvel[motor])

            laws.append(add_torque)
        if self._line is not None:
            laws.append(self._speed_law(*self._line))
        return laws

    def _friction_law(self, varying: Callable[[Array, Array, Array], Array]) -> Callable[[], None]:
        """Set the friction level from speed, the actuators' torque and the other torques on the joints."""
        model, data, get, at, dof = self._model, self._data, self._hidden.get, self._plant.position, self._plant.dof
        loss, none = model.dof_frictionloss, np.zeros(len(dof))
        outside = any(get("load_friction", name).any() for name in ("external", "static"))
        spring, angle = model.jnt_stiffness[model.dof_jntid[dof]], model.qpos_spring[at]

        def set_friction() -> None:
            outer = none
            if outside:
                outer = self._beside - spring * (data.qpos[at] - angle) - self._plant.load(data.qfrc_bias)
            loss[dof] = varying(data.qvel[dof], data.actuator_force, outer)

        return set_friction

    def _torque_laws(self) -> list[Callable[[], None]]:
        """Apply the torques on the joints besides the actuators'."""
        data, get, at, dof = self._data, self._hidden.get, self._plant.position, self._plant.dof
        amplitude, frequency, phase = (get("torque_ripple", p) for p in ("amplitude", "frequency", "phase"))
        drag, constant, bristle = get("quadratic_drag", "coefficient"), self._constant_torque, self._bristle
        motor_at, motor, damper = self._plant.motor_position, self._plant.motor_dof, gear_damper(self._hidden)
        half, bias = get("backlash", "gap") / 2, get("torque_bias", "torque")
        if bristle is None and not (amplitude.any() or drag.any() or damper.any()):
            return []

        def set_torque() -> None:
            speed, ripple = data.qvel[dof], amplitude * np.sin(frequency * data.qpos[at] + phase)
            torque = constant + ripple
            if bristle is not None:
                torque -= bristle(self._bend, speed, self.timestep)
            self._beside = torque - constant + bias
            meshed = np.abs(data.qpos[motor_at] - data.qpos[at]) >= half
            passed = damper * meshed * (data.qvel[motor] - speed)
            data.qfrc_applied[motor] = -passed
            data.qfrc_applied[dof] = torque - drag * speed * np.abs(speed) + passed

        return [set_torque]

    def _speed_law(self, top: Array, rise: Array, bottom: Array, fall: Array) -> Callable[[], None]:
        """Limit the actuator to the torque-speed line where the servo's torque exceeds it."""
        model, data, at, dof = self._model, self._data, self._plant.motor_position, self._plant.motor_dof
        gain, bias, kp, kd = model.actuator_gainprm, model.actuator_biasprm, self._kp, self._kd

        def limit_speed() -> None:
            v, share = data.qvel[dof], self._share
            wanted = kp * (data.ctrl - data.qpos[at]) - kd * v
            up, down = wanted > rise * (top - v), wanted < fall * (bottom - v)
            line = up | down
            gain[:, 0] = np.where(line, 0.0, kp) * share
            bias[:, 0] = np.where(up, rise * top, np.where(down, fall * bottom, 0.0)) * share
            bias[:, 1] = np.where(line, 0.0, -kp) * share
            bias[:, 2] = np.where(up, -rise, np.where(down, -fall, -kd)) * share

        return limit_speed

    def run(self, setpoint: Callable[[Array], Array], duration: float) -> tuple[Array, Array, Array, Array]:
        """Play set points (k,) s -> (k, n) from rest; returns time (T,), true position, velocity, torque (T, n).

        They are of every step, in recorded units; torque is the actuator's, position and velocity are the motor's.

        Raises: SimulationError when the arm does not come to rest first or the engine diverges.
        """
        steps = int(np.ceil(duration / self.timestep - 1e-9)) + 2
        wanted = shape_command(lambda t: self._zero + self._stroke * setpoint(t), self._hidden, steps, self.timestep)
        wanted -= self._offset
        self._settle(wanted[0])
        q, v, sent = self._play(wanted, warming=True)
        q, v = q[:-1], (v[:-1] + v[1:]) / 2  # the engine's velocity is that of half a step earlier
        torque = self._drive(sent[:-1], q, v)
        time = np.arange(steps - 1) * self.timestep
        return time, (q - self._zero) / self._stroke, v / self._stroke, torque * self._stroke

    def begin(self, setpoint: Array) -> None:
        """Bring the arm to rest at a set point (n,), recorded units, to begin a motion that `advance` plays.

        Raises: SimulationError when the arm does not come to rest there.
        """
        self._path = CommandPath(self._hidden, self.timestep)
        self._settle(self._zero + self._stroke * setpoint - self._offset)

    def advance(self, setpoint: Callable[[Array], Array], steps: int) -> None:
        """Play the next steps of the motion; setpoint: (k,) s since it began -> (k, n), recorded units.

        Raises: SimulationError when the engine diverges.
        """
        wanted = self._path.shape(lambda t: self._zero + self._stroke * setpoint(t), steps) - self._offset
        self._play(wanted, warming=True)

    def refresh(self) -> None:
        """Update MuJoCo's derived quantities after a caller has changed `model` or `data`."""
        self._mujoco.mj_forward(self._model, self._data)

    @property
    def model(self) -> Any:
        """MuJoCo's model; a caller may move bodies that are not part of the robot."""
        return self._model

    @property
    def data(self) -> Any:
        """MuJoCo's present state."""
        return self._data

    def encoders(self) -> Array:
        """Present encoder readings (n,), without noise, recorded units."""
        return (self._data.qpos[self._plant.motor_position] + self._offset - self._zero) / self._stroke

    def speeds(self) -> Array:
        """Present speed of the motors (n,), recorded units per second."""
        return self._data.qvel[self._plant.motor_dof] / self._stroke

    def _drive(self, sent: Array, q: Array, v: Array) -> Array:
        """The actuator's torque (T, n) from its control law, at the speed in the middle of the step."""
        torque = self._kp * (sent - q) - self._kd * v
        if self._line is not None:
            top, rise, bottom, fall = self._line
            torque = np.clip(torque, fall * (bottom - v), rise * (top - v))
        return np.clip(torque, -self._limit, self._limit)

    def _settle(self, first: Array, longest: float = 4.0) -> None:
        """Bring the arm to rest at a set point (n,); the state is cached for the next motion that starts there.

        In the last blocks, a speed below CREEP counts as rest, because inside a dead zone a joint may creep for
        minutes.
        """
        self._reset(self._plant.pose(first), np.zeros(len(first)), np.zeros(len(first)), first)
        self._firmware.rest(self._firmware.holding(self._plant.load(self._data.qfrc_bias - self._data.qfrc_passive)))
        block = int(0.25 / self.timestep)
        blocks = int(longest / 0.25)
        for left in range(blocks, -1, -1):
            if first.tobytes() in self._rest:
                self._reset(*self._rest[first.tobytes()], first)
                return
            _, v, _ = self._play(np.broadcast_to(first, (block, len(first))), warming=False)
            if np.abs(v[-block // 5 :] / self._stroke).max() < (1e-5 if left > 1 else CREEP):
                self._rest[first.tobytes()] = self._data.qpos.copy(), self._bend.copy(), self._firmware.integral.copy()
        raise SimulationError(f"the stand-in does not rest at its first command within {longest:g} s.")

    def _reset(self, pose: Array, bend: Array, integral: Array, command: Array) -> None:
        """Reset to a pose (nq,), at rest and cool, with the servo's torque computed, as friction may depend on it."""
        model, data = self._model, self._data
        self._set_servo(self._strength)
        self._bend[:] = bend
        self._firmware.rest(integral)
        self._mujoco.mj_resetData(model, data)
        data.qfrc_applied[self._plant.dof] = self._constant_torque
        data.qpos[:], data.ctrl[:] = pose, command
        self._mujoco.mj_forward(model, data)

    def _play(self, wanted: Array, warming: bool) -> tuple[Array, Array, Array]:
        """Step through set points (k, n); returns position, velocity and actuator input at the start of each step."""
        model, data, step, laws = self._model, self._data, self._mujoco.mj_step, self._laws(warming)
        ctrl, qpos, qvel = data.ctrl, data.qpos, data.qvel
        q, v, sent = np.empty((len(wanted), model.nq)), np.empty((len(wanted), model.nv)), np.array(wanted)
        for k in range(len(wanted)):
            ctrl[:] = self._wanted = wanted[k]
            for law in laws:
                law()
            q[k], v[k], sent[k] = qpos, qvel, ctrl
            step(model, data)
        if any(warning.number for warning in data.warning) or not np.isfinite(qvel).all():
            raise SimulationError("the stand-in's engine diverged; use smaller gains or a shorter timestep.")
        return q[:, self._plant.motor_position], v[:, self._plant.motor_dof], sent

    @property
    def moving_mass(self) -> float:
        """Mass of all links that are not fixed to the world, kg."""
        return float(self._model.body_mass[self._model.body_weldid != 0].sum())

    def gravity_torque(self, position: Array) -> Array:
        """Torque (T, n) N m that holds the arm still at measured positions (T, n)."""
        data, out = self._mujoco.MjData(self._model), []
        for row in np.atleast_2d(position):
            data.qpos[:] = self._plant.pose(self._zero + self._stroke * row - self._offset)
            self._mujoco.mj_forward(self._model, data)
            out.append(self._plant.load(data.qfrc_bias - data.qfrc_passive) * self._stroke)
        return np.array(out)
