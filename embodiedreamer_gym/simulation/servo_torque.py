"""Servo torque besides stiffness times error: feed-forward, gravity compensation, integrals, a dead band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.effects import CATALOGUE, JointState, ServoState
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive_setup import Law

ORDER = {name: place for place, name in enumerate(CATALOGUE)}  # in which laws act; a user's laws act first


class ServoTorque:
    """The laws of the stage "torque" on a batch of B robots, and the gravity compensation that the model's file states.

    counts: whether there is any such torque. damping: of the servo (B, n), N m s/rad.
    """

    def __init__(self, model: RobotModel, laws: Sequence[Law], damping: np.ndarray) -> None:
        self._model, self._damping = model, damping
        self._laws = sorted(laws, key=lambda law: ORDER.get(law.effect.name, -1))
        self._share = model.gravity_compensation
        self.counts = bool(laws) or bool(self._share.any())
        self._masses = model.bodies.pack(model.nominal_mechanics)
        self._heard = self._slope = np.zeros_like(damping)

    def start(
        self, pull: np.ndarray, heard: np.ndarray, measured: np.ndarray, motor: JointState, carried: np.ndarray
    ) -> np.ndarray:
        """Put all memories at rest; return the servo's torque (B, n) at the first command `heard`, N m.

        pull: stiffness times error; carried: torque that it has to command to hold the joints at their positions.
        """
        self._heard, self._slope = heard, np.zeros_like(heard)
        state = self._state(pull, measured, motor)
        torque = self._compensated(pull, state)
        for law in self._laws:
            missing = carried - torque
            law.memory = law.effect.start(missing, law.p, motor.dt)
            torque, _ = law.effect.law(torque, state, law.memory, law.p)
        return torque

    def torque(self, pull: np.ndarray, heard: np.ndarray, measured: np.ndarray, motor: JointState) -> np.ndarray:
        """Torque (B, n) that the servo commands for the command `heard`, before damping and limits, N m."""
        slope = (heard - self._heard) / motor.dt
        speed = slope + 0.5 * (slope - self._slope)  # extrapolated to this instant, like the joints' velocity
        self._heard, self._slope = heard, slope
        return self._given(pull, self._state(pull, measured, motor, speed), keep=True)

    def given(
        self, pull: np.ndarray, measured: np.ndarray, motor: JointState, speed: np.ndarray, keep: bool = False
    ) -> np.ndarray:
        """Torque (B, n) that the servo commands for a command of this speed; keep: whether memories are advanced."""
        return self._given(pull, self._state(pull, measured, motor, speed), keep)

    def keep(self, damping: np.ndarray) -> None:
        """Drop all but the first samples, which have this damping (B, n)."""
        self._damping = damping
        self._heard, self._slope = self._heard[: len(damping)], self._slope[: len(damping)]

    def _state(
        self, pull: np.ndarray, measured: np.ndarray, motor: JointState, speed: np.ndarray | None = None
    ) -> ServoState:
        speed = np.zeros_like(pull) if speed is None else speed
        return ServoState(measured, motor.velocity, motor.torque, motor.dt, motor.time, pull=pull, damping=self._damping,
                          command_velocity=speed, weigh=self._weigh)  # fmt: skip

    def _given(self, pull: np.ndarray, state: ServoState, keep: bool) -> np.ndarray:
        torque = self._compensated(pull, state)
        for law in self._laws:
            torque, memory = law.effect.law(torque, state, law.memory, law.p)
            law.memory = memory if keep else law.memory
        return torque

    def _compensated(self, pull: np.ndarray, state: ServoState) -> np.ndarray:
        return pull + self._share * state.gravity_torque if self._share.any() else pull

    def _weigh(self, position: np.ndarray) -> np.ndarray:
        position = np.ascontiguousarray(position)
        return self._model.bodies.mass_matrix_and_bias(position, np.zeros_like(position), self._masses)[1]
