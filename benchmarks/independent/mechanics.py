"""Faults of gears, bearings, links and loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.independent.fault import TICK, Fault, State, Values
from benchmarks.independent.plant import Robot

STILL = 0.002  # rad/s; below it, a joint's direction is that of the torque on it


class CoulombFriction(Fault):
    """MuJoCo's frictionloss."""

    def values(self) -> Values:
        return {"torque": self.by_joint(self.usual * self.amount)}

    def friction(self, state: State) -> np.ndarray:
        return self.usual * self.amount


class StribeckFriction(Fault):
    """Friction that falls from its static to its sliding value as exp(-(v / vs)^2)."""

    def shape(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sliding and extra static friction, N m, and Stribeck speed, rad/s, (n,) each."""
        sliding = 0.6 * self.usual * self.amount
        return sliding, sliding * (0.4 + 0.8 * self.draw[:, 2]), 0.03 * 8 ** self.draw[:, 3]

    def values(self) -> Values:
        return dict(zip(("sliding", "extra_static", "speed"), map(self.by_joint, self.shape()), strict=True))

    def friction(self, state: State) -> np.ndarray:
        sliding, extra, speed = self.shape()
        return sliding + extra * np.exp(-((state.velocity / speed) ** 2))


class LoadFriction(Fault):
    """A gear that loses a share of the motor torque to friction."""

    def values(self) -> Values:
        return {"coefficient": self.by_joint(0.8 * self.amount)}

    def friction(self, state: State) -> np.ndarray:
        return 0.8 * self.amount * np.abs(state.torque)


class DirectionDependentFriction(Fault):
    """Different friction forward and backward; at rest, the torque's direction decides."""

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Friction forward and backward, (n,), N m."""
        strong = self.usual * self.amount
        weak = strong * 0.6 * self.draw[:, 2]
        return np.where(self.signs > 0, strong, weak), np.where(self.signs > 0, weak, strong)

    def values(self) -> Values:
        return dict(zip(("forward", "backward"), map(self.by_joint, self.sides()), strict=True))

    def friction(self, state: State) -> np.ndarray:
        data, at = state.plant.data, state.plant.motor
        push = np.where(np.abs(state.velocity) > STILL, state.velocity, state.torque - data.qfrc_bias[at])
        return np.where(push > 0, *self.sides())


class QuadraticDrag(Fault):
    """Drag torque -c v |v|."""

    def values(self) -> Values:
        return {"coefficient": self.by_joint(2 * self.usual * self.amount)}

    def load(self, state: State) -> np.ndarray:
        return -2 * self.usual * self.amount * state.velocity * np.abs(state.velocity)


class Hysteresis(Fault):
    """Dahl's friction (1968): dz/dt = v / travel (1 - z sign v), torque -T z."""

    def values(self) -> Values:
        return {"torque": self.by_joint(self.usual * self.amount)}

    def begin(self, command: np.ndarray) -> None:
        self.bend = np.zeros(len(command))

    def load(self, state: State) -> np.ndarray:
        travel = 0.02 * 8 ** self.draw[:, 2]
        change = state.velocity / travel * (1 - self.bend * np.sign(state.velocity)) * TICK
        self.bend = np.clip(self.bend + change, -1, 1)
        return -self.usual * self.amount * self.bend


class TorqueBias(Fault):
    """A constant torque."""

    def values(self) -> Values:
        return {"torque": self.by_joint(self.usual * self.signs * self.amount)}

    def load(self, state: State) -> np.ndarray:
        return self.usual * self.signs * self.amount


class TorqueRipple(Fault):
    """A torque A sin(f q + phase), as from the poles of a motor with a gear."""

    def shape(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Amplitude, N m, periods in a radian times 2 pi, and phase, rad, (n,) each."""
        return self.usual * self.amount, 6 * 10 ** self.draw[:, 2], 2 * np.pi * (self.draw[:, 3] - 0.5)

    def values(self) -> Values:
        return dict(zip(("amplitude", "frequency", "phase"), map(self.by_joint, self.shape()), strict=True))

    def load(self, state: State) -> np.ndarray:
        size, often, phase = self.shape()
        return size * np.sin(often * state.position + phase)


class JointSpring(Fault):
    """A spring with its rest position at one angle."""

    def shape(self) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness, N m/rad, and angle without torque, rad, (n,) each."""
        return 2 * self.usual * self.amount, self.arm.each("home") + self.arm.each("reach") * (2 * self.draw[:, 2] - 1)

    def values(self) -> Values:
        return dict(zip(("stiffness", "angle"), map(self.by_joint, self.shape()), strict=True))

    def load(self, state: State) -> np.ndarray:
        stiffness, angle = self.shape()
        return stiffness * (angle - state.position)


class Payload(Fault):
    """A steel ball up to 8 cm from the tip."""

    per_arm = True

    def thing(self) -> tuple[float, np.ndarray]:
        """Mass, kg, and position in the tip's frame, (3,), m."""
        along, around, far = 2 * self.draw[0, 0] - 1, 2 * np.pi * self.draw[0, 1], 0.08 * self.draw[0, 2]
        flat = np.sqrt(1 - along**2)
        mass = 0.8 * self.size * float(self.arm.each("mass").sum())
        return mass, far * np.array([flat * np.cos(around), flat * np.sin(around), along])

    def values(self) -> Values:
        mass, place = self.thing()
        return {"mass": {"tip": mass}} | {axis: {"tip": float(x)} for axis, x in zip("xyz", place, strict=True)}

    def build(self, robot: Robot) -> Robot:
        return replace(robot, payload=self.thing())


class BaseTilt(Fault):
    """A tilted base: gravity in its frame is rotated about x and y."""

    per_arm = True

    def values(self) -> Values:
        return {"tilt": {"tip": 0.3 * self.size}}

    def build(self, robot: Robot) -> Robot:
        tilt, about = 0.3 * self.size, 2 * np.pi * self.draw[0, 0]
        down = np.array([np.sin(tilt) * np.cos(about), np.sin(tilt) * np.sin(about), -np.cos(tilt)])
        x, y, z = (float(g) for g in 9.81 * down)
        return replace(robot, gravity=(x, y, z))


class RotorInertia(Fault):
    """A heavier rotor."""

    def values(self) -> Values:
        return {"inertia": self.by_joint(self.extra())}

    def extra(self) -> np.ndarray:
        """Additional rotor inertia, (n,), kg m^2 at the joint."""
        inertia = self.nominal.stiffness / (2 * np.pi * self.arm.each("hertz")) ** 2
        return 2 * inertia * self.amount

    def build(self, robot: Robot) -> Robot:
        return replace(robot, rotor=robot.rotor + self.extra())


class JointElasticity(Fault):
    """A spring and a damper between rotor and link, two bodies; encoder and servo are on the rotor."""

    def values(self) -> Values:
        return {"compliance": self.by_joint(2 * self.amount / self.nominal.stiffness)}

    def build(self, robot: Robot) -> Robot:
        stiffness = self.nominal.stiffness / np.maximum(2 * self.amount, 1e-9)
        settling = 0.002 + 0.006 * self.draw[:, 2]
        springs = {int(j): (float(stiffness[j]), float(stiffness[j] * settling[j])) for j in self.at}
        return replace(robot, springs=robot.springs | springs)


class Backlash(Fault):
    """Free play between rotor and link, two bodies; encoder and servo are on the rotor."""

    def values(self) -> Values:
        return {"gap": self.by_joint(0.12 * self.amount)}

    def build(self, robot: Robot) -> Robot:
        return replace(robot, gaps=robot.gaps | {int(j): float(0.12 * self.amount[j]) for j in self.at})


MECHANICS: dict[str, type[Fault]] = {
    "coulomb_friction": CoulombFriction,
    "stribeck_friction": StribeckFriction,
    "load_friction": LoadFriction,
    "direction_dependent_friction": DirectionDependentFriction,
    "quadratic_drag": QuadraticDrag,
    "hysteresis": Hysteresis,
    "torque_bias": TorqueBias,
    "torque_ripple": TorqueRipple,
    "joint_spring": JointSpring,
    "payload": Payload,
    "base_tilt": BaseTilt,
    "rotor_inertia": RotorInertia,
    "joint_elasticity": JointElasticity,
    "backlash": Backlash,
}
