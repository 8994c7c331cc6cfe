"""Simulation of one log: a 1 kHz position servo, MuJoCo, faults at their places, encoders and a current sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.independent.fault import TICK, Fault, State
from benchmarks.independent.motions import Path
from benchmarks.independent.plant import STEP, Plant, Robot, usual_torque

REST = 1.0  # s at the first command before the log
TORQUE_NOISE = 0.002  # sd of the torque noise of each tick, as a share of the usual torque


@dataclass(frozen=True)
class Truth:
    """A log without sensor noise: time (T,), command, encoder angle and servo torque (T, n)."""

    time: np.ndarray
    command: np.ndarray
    position: np.ndarray
    effort: np.ndarray


@dataclass(frozen=True)
class Logger:
    """Logging settings: seconds, samples per second, and whether the controller holds commands or interpolates."""

    seconds: float
    hz: float
    hold: bool

    def times(self) -> np.ndarray:
        """Times of the samples, (T,), s, rounded to ticks: a stamp is the time at which a sample was taken."""
        return np.round(np.arange(round(self.seconds * self.hz) + 1) / self.hz / TICK) * TICK

    def commands(self, path: Path) -> np.ndarray:
        """The commands at every tick of the log, (ticks, n): held or linear between samples."""
        times = self.times()
        samples, ticks = path(times), np.arange(round(self.seconds / TICK) + 1) * TICK
        if self.hold:
            return samples[np.searchsorted(times, ticks + 1e-9, side="right") - 1]
        return np.stack([np.interp(ticks, times, column) for column in samples.T], axis=1)


def simulate(
    robot: Robot, faults: Sequence[Fault], path: Path, logger: Logger, rng: np.random.Generator | None = None
) -> Truth:
    """Simulate one log of a robot; with a random generator, the drive's torque has a small noise.

    A sample is the state that the controller reads before it sends the sample's command. With held commands, the
    sample's effort is therefore still that of the previous command.
    """
    for fault in faults:
        robot = fault.build(robot)
    plant, ticks = Plant(robot), logger.commands(path)
    state = State(plant, lambda time: ticks[min(max(round(time / TICK), 0), len(ticks) - 1)])
    _rest(plant, ticks[0])
    for fault in faults:
        fault.begin(ticks[0])
    before, noise = round(REST / TICK), TORQUE_NOISE * usual_torque(robot.arm)
    positions, efforts = np.empty_like(ticks), np.empty_like(ticks)
    for k in range(-before, len(ticks)):
        state.time = k * TICK
        measured = _look(state, faults)
        if k >= 0:
            positions[k], efforts[k] = measured, state.torque
        _servo(state, faults, measured, noise * rng.standard_normal(len(noise)) if rng else 0.0)
        for _ in range(round(TICK / STEP)):
            mujoco.mj_step(plant.model, plant.data)
    rows = np.minimum(np.round(logger.times() / TICK).astype(int), len(ticks) - 1)
    return Truth(logger.times(), path(logger.times()), positions[rows], efforts[rows])


def _rest(plant: Plant, command: np.ndarray) -> None:
    """Place the arm in static equilibrium of servo stiffness and gravity at this command."""
    plant.data.qpos[plant.motor] = command
    for _ in range(5):
        mujoco.mj_forward(plant.model, plant.data)
        plant.data.qpos[plant.motor] = command - plant.data.qfrc_bias[plant.motor] / plant.robot.stiffness


def _look(state: State, faults: Sequence[Fault]) -> np.ndarray:
    """Read the motor state; returns the encoder readings."""
    data, at = state.plant.data, state.plant.motor
    state.position, state.velocity = data.qpos[at].copy(), data.qvel[at].copy()
    measured = state.position
    for fault in faults:
        measured = fault.measured(state, measured)
    return measured


def _servo(state: State, faults: Sequence[Fault], measured: np.ndarray, noise: np.ndarray | float) -> None:
    """Run one servo tick: from the command to torques and friction for the next physics steps."""
    plant = state.plant
    reference = state.command(state.time)
    for fault in faults:
        reference = fault.reference(state, reference)
    error = reference - measured
    for fault in faults:
        error = fault.error(state, error)
    torque = plant.robot.stiffness * error - plant.robot.damping * state.velocity
    for fault in faults:
        torque = fault.drive(state, torque)
    load, friction = np.zeros(len(torque)), np.zeros(len(torque))
    for fault in faults:
        load += fault.load(state)
        friction += fault.friction(state)
    state.torque = torque
    plant.data.qfrc_applied[plant.motor] = torque + load + noise
    plant.model.dof_frictionloss[plant.motor] = friction
