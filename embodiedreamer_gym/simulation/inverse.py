"""Inverse runs: the effort that a model needs for a measured motion, if a log contains no command.

The motion is smoothed, the torque of the rigid bodies is computed from it (recursive Newton-Euler), friction and the
loads of the effects are added, and the drive's laws are inverted. Stages before the drive (command, servo) and
compliant gears are ignored. Torques pass the same filter as the log's effort, which is smoothing twice (see
`smooth_derivatives`; Swevers et al., IEEE Control Systems 27, 2007). The memories of loads and friction are advanced
along the log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from embodiedreamer_gym.effects import JointState
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Motion, Recording, smooth, smooth_derivatives, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive, Sets
from embodiedreamer_gym.simulation.rollout import Rollout, check_names, simulate_sets

RESTING = 3.0  # standard deviations of its noise below which a speed may be zero
SLOWEST = 1e-4  # unit/s; the same for a sensor that shows no noise
LOOPS = 2  # iterations for friction that depends on the torque
NUDGE = 1e-3  # relative torque step for the slope of the drive's laws


def run_sets(
    model: RobotModel, recordings: Sequence[Recording], sets: Sets | None = None, hold: str | None = None,
    dt: float = TIME_STEP,
) -> list[Rollout]:  # fmt: skip
    """Runs of a model on recordings under P parameter sets: free runs, or inverse runs if no log has a command.

    Raises: SimulationError if a recording is not of this robot, or only some contain a command.
    """
    without = [r for r in recordings if r.command is None]
    if not without:
        return simulate_sets(model, recordings, sets, dt, hold)
    if len(without) < len(recordings):
        raise SimulationError(
            f"recording {without[0].name} has no command but others have one; give either logs with commands or logs without."
        )
    return [inverse_sets(model, recording, sets) for recording in recordings]


def inverse_sets(model: RobotModel, recording: Recording, sets: Sets | None = None) -> Rollout:
    """Torque and effort (P, T, n) that a recording's motion needs under P parameter sets, and its smoothed motion.

    Raises: SimulationError if the recording is not of this robot or has no effort to compare with.
    """
    check_names(model, recording)
    if recording.effort is None:
        raise SimulationError(f"recording {recording.name} holds neither a command nor an effort; one is needed.")
    track = _Track(Drive(model, sets), recording)
    torque = track.torque()
    return Rollout(recording.time, track.position, track.velocity, torque, track.effort(torque))


def resting(recording: Recording, motion: Motion | None = None) -> np.ndarray:
    """Samples (T, n) at which a joint may stand still, so that its friction is undetermined."""
    motion = motion or smooth_motion(recording)
    return np.abs(motion.velocity) <= slow_speed(motion)


def slow_speed(motion: Motion) -> np.ndarray:
    """Speed (n,) below which a joint may stand still, unit/s."""
    return np.maximum(RESTING * motion.speed_noise, SLOWEST)


class _Track:
    """A motion under P parameter sets; arrays (P, T, n)."""

    def __init__(self, drive: Drive, recording: Recording) -> None:
        self.drive, self.recording, self.count = drive, recording, drive.sets
        motion, self.derivatives = smooth_motion(recording), smooth_derivatives(recording)
        self.slow = slow_speed(motion)
        self.steps = np.gradient(recording.time)
        seen = np.repeat(motion.position[None], self.count, axis=0)
        self.velocity = np.repeat(motion.velocity[None], self.count, axis=0)
        self.external: np.ndarray | None = None
        self.position = 2 * seen - self._laws("sensor", seen, seen)  # exact for an offset

    def torque(self) -> np.ndarray:
        """Torque (P, T, n) in N m that the drive has to produce before its laws."""
        rigid = self._rigid_bodies()
        load = self._smoothed(self._laws("load", np.zeros_like(rigid), rigid), 2)
        torque = carried = rigid - load
        if any(effect.feels_external for effect, _ in self.drive.budgets):
            self.external = load - self._smoothed(self._bodies(np.zeros_like(self.derivatives.acceleration)))
        for _ in range(LOOPS if self.drive.budgets else 0):
            torque = carried + self._smoothed(self._friction(torque), 2)
        return self._asked(torque)

    def effort(self, torque: np.ndarray) -> np.ndarray:
        """The log's effort for torques (P, T, n); laws of this stage have no memory."""
        joint, arm = self._joint(0, torque), self.drive.model.tree.arm
        joint.dt = 1.0 / self.recording.hz
        for law in self.drive.laws["effort"]:
            of_arm = {p.name for p in law.effect.parameters if p.per == "arm"}
            values = {k: (v[:, arm] if k in of_arm else v)[:, None] for k, v in vars(law.p).items()}
            torque, _ = law.effect.law(torque, joint, None, SimpleNamespace(**values))
        return torque

    def _rigid_bodies(self) -> np.ndarray:
        """Torque (P, T, n) of the rigid bodies, including that of the rotors and of viscous friction."""
        speed, acceleration, servo = self.derivatives.velocity, self.derivatives.acceleration, self.drive.servo
        rotor, viscous = servo["rotor_inertia"][:, None], servo["viscous_friction"][:, None]
        return self._smoothed(self._bodies(acceleration) + rotor * acceleration + viscous * speed)

    def _bodies(self, acceleration: np.ndarray) -> np.ndarray:
        """Torque (P, T, n) of the bodies under an acceleration (T, n), by inverse dynamics."""
        first, place = self._different_bodies()
        samples, n = self.position.shape[1:]
        q = np.ascontiguousarray(np.swapaxes(self.position[first], 0, 1).reshape(-1, n))
        v, a = (
            np.repeat(x, len(first), axis=0) for x in (self.derivatives.velocity, acceleration)
        )  # sample b: set b mod P
        mechanics = self.drive.mechanics
        if len(mechanics.mass) > 1:
            parts = ("mass", "first_moment", "inertia", "gravity")
            mechanics = replace(mechanics, **{name: getattr(mechanics, name)[first] for name in parts})
        torque = self.drive.model.bodies.inverse_dynamics(q, v, a, mechanics)[0]
        return np.swapaxes(torque.reshape(samples, len(first), n), 0, 1)[place]

    def _different_bodies(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameter sets (k,) whose bodies or positions differ, and for each set (P,) the index of its equal there."""
        if self.drive.laws["sensor"]:
            return np.arange(self.count), np.arange(self.count)
        m = self.drive.mechanics
        values = np.column_stack([x.reshape(len(x), -1) for x in (m.mass, m.first_moment, m.inertia, m.gravity)])
        first, place = np.unique(values, axis=0, return_index=True, return_inverse=True)[1:]
        return first, np.broadcast_to(place.reshape(-1), self.count)

    def _joint(self, k: int, torque: np.ndarray) -> JointState:
        time = float(self.recording.time[k] - self.recording.time[0])
        external = None if self.external is None else self.external[:, k]
        return JointState(self.position[:, k], self.velocity[:, k], torque[:, k], float(self.steps[k]), time, external)

    def _all_samples(self, torque: np.ndarray) -> JointState:
        """State at all samples of all parameter sets, in rows (P T, n), for laws without memory; dt, time (P T, 1)."""
        n = torque.shape[2]
        dt, time = (np.tile(x, self.count)[:, None] for x in (self.steps, self.recording.time - self.recording.time[0]))
        external = None if self.external is None else self.external.reshape(-1, n)
        position, velocity, drive = (x.reshape(-1, n) for x in (self.position, self.velocity, torque))
        return JointState(position, velocity, drive, dt, time, external)

    def _laws(self, stage: str, signal: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Output of a stage for a signal (P, T, n), sample by sample; the memories of its laws are advanced."""
        laws = self.drive.laws[stage]
        if not laws:
            return signal
        if stage == "sensor":
            self.position = signal
        out = np.array(signal, float)
        memory = [law.effect.start(out[:, 0], law.p, 1.0 / self.recording.hz) for law in laws]
        for k in range(out.shape[1]):
            joint, x = self._joint(k, torque), out[:, k]
            for i, law in enumerate(laws):
                x, memory[i] = law.effect.law(x, joint, memory[i], law.p)
            out[:, k] = x
        return out

    def _friction(self, torque: np.ndarray) -> np.ndarray:
        """Friction torque (P, T, n) of all budgets; proportional to the speed where a joint may stand still."""
        taken, joint = np.zeros_like(torque), self._all_samples(torque)
        for effect, p in self.drive.budgets:
            of_samples = {k: np.repeat(v, torque.shape[1], axis=0) for k, v in vars(p).items()}
            both = effect.friction(joint, SimpleNamespace(**of_samples))
            if both is not None:
                taken += np.where(joint.velocity > 0, *both).reshape(torque.shape)
        return taken * np.clip(self.velocity / self.slow, -1.0, 1.0)

    def _smoothed(self, torque: np.ndarray, times: int = 1) -> np.ndarray:
        """Torques (P, T, n) smoothed in time, once or more often."""
        if not torque.any():
            return torque
        sets, samples, n = torque.shape
        columns = np.swapaxes(torque, 0, 1).reshape(samples, sets * n)
        for _ in range(times):
            columns = smooth(self.recording, columns)
        return np.swapaxes(columns.reshape(samples, sets, n), 0, 1)

    def _asked(self, torque: np.ndarray) -> np.ndarray:
        """Torque of the drive of which this torque reaches the joint, with the drive's laws linearised."""
        if not self.drive.laws["drive"]:
            return torque
        step = NUDGE * (1.0 + np.abs(torque))
        given = self._laws("drive", torque, torque)
        gain = (self._laws("drive", torque + step, torque) - given) / step
        return torque + (torque - given) / np.maximum(gain, 1e-6)
