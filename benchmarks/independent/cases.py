"""A case: a robot that differs from its description, its faults, four logs, and the files that a user would have."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np

from benchmarks.independent.arms import ARMS, Arm, urdf
from benchmarks.independent.electronics import ELECTRONICS
from benchmarks.independent.fault import Fault, Values
from benchmarks.independent.mechanics import MECHANICS
from benchmarks.independent.motions import KINDS, Path
from benchmarks.independent.outside import OUTSIDE
from benchmarks.independent.plant import Robot, nominal, usual_torque
from benchmarks.independent.rollout import Logger, Truth, simulate
from embodiedreamer_gym.recordings import Recording, save_recording

FAULTS = ELECTRONICS | MECHANICS | OUTSIDE
SINGLES = (*ELECTRONICS, *MECHANICS)
FAMILIES = (
    ("command_delay", "command_lowpass", "command_rate_limit"),
    ("servo_deadzone", "torque_saturation", "voltage_limit"),
    ("coulomb_friction", "stribeck_friction", "load_friction", "direction_dependent_friction", "hysteresis",
     "quadratic_drag"),
    ("torque_bias", "torque_ripple", "joint_spring", "payload", "base_tilt", "encoder_offset"),
    ("rotor_inertia", "joint_elasticity", "backlash"),
)  # fmt: skip
EXCITING = ("sines", "point_to_point", "ramps", "teleoperation")  # two for training, two held out
AS_A_PERSON = ("teleoperation",) * 4
SECONDS = 6.0
LEAST, MOST = 3.0, 60.0  # range of a fault's visibility, sensor noises
CLOSE = 1.25  # factor within which a visibility is accepted
ATTEMPTS = 6  # most choices of joints, if a fault cannot get the wanted visibility
STEPS = 10  # most sizes tried for each choice


@dataclass(frozen=True)
class Sensors:
    """Sensors: encoder bits, encoder noise (rad), and effort noise as a share of the usual torque."""

    noise: float
    bits: int
    effort: float = 0.02

    @property
    def quantum(self) -> float:
        """The encoder's step, rad."""
        return 2 * np.pi / 2**self.bits

    @property
    def sigma(self) -> float:
        """Noise and rounding together, rad."""
        return float(np.hypot(self.noise, self.quantum / np.sqrt(12)))

    def log(self, name: str, arm: Arm, truth: Truth, hold: bool, rng: np.random.Generator) -> Recording:
        """The recording of a log; its noise is not declared but estimated, as for a real log."""
        noisy = truth.position + self.noise * rng.standard_normal(truth.position.shape)
        effort = truth.effort + self.effort * usual_torque(arm) * rng.standard_normal(truth.effort.shape)
        position = np.round(noisy / self.quantum) * self.quantum
        return Recording(name, arm.names, truth.time, position, truth.command, effort=effort,
                         command_hold="hold" if hold else "linear")  # fmt: skip


@dataclass(frozen=True)
class IndependentCase:
    """A robot, its faults with their visibility in total and by joint, and its training and held-out logs."""

    robot: Robot
    faults: Mapping[str, Fault]
    visibility: Mapping[str, float]
    shown: Mapping[str, Mapping[str, float]]
    train: tuple[Recording, ...]
    test: tuple[Recording, ...]

    @property
    def hidden(self) -> dict[str, Values]:
        """Effect -> parameter -> joint or end effector -> value."""
        return {name: fault.values() for name, fault in self.faults.items()}

    def write(self, folder: str | FilePath) -> FilePath:
        """Write a user's files (URDF, model with nominal gains, logs as csv); returns the model's path."""
        place, made = FilePath(folder), nominal(self.robot.arm)
        servo = {"stiffness": made.stiffness.tolist(), "damping": made.damping.tolist()}
        model = {
            "name": made.arm.name,
            "robot": {"urdf": "arm.urdf", "joints": list(made.arm.names), "end_effectors": ["tip"]},
            "servo": servo,
            "rotor_inertia": made.rotor.tolist(),
            "viscous_friction": made.viscous.tolist(),
        }
        for part, logs in (("train", self.train), ("test", self.test)):
            (place / part).mkdir(parents=True, exist_ok=True)
            for log in logs:
                save_recording(log, place / part / f"{log.name}.csv")
        (place / "arm.urdf").write_text(urdf(made.arm))
        (place / "model.json").write_text(json.dumps(model, indent=1))
        return place / "model.json"


def partners(effect: str) -> list[str]:
    """Effects of other families."""
    return [other for family in FAMILIES if effect not in family for other in family]


def draw(
    effects: Sequence[str],
    arm: str,
    wanted: float,
    rng: np.random.Generator,
    kinds: Sequence[str] = EXCITING,
    hz: float = 100.0,
    seconds: float = SECONDS,
) -> IndependentCase:
    """Draw a case; each fault alone, without a refit, has approximately the wanted visibility, if one is found.

    kinds: kinds of the four motions; the last two are held out. hz: samples per second.
    """
    robot = draw_robot(ARMS[arm], rng)
    sensors = Sensors(rng.uniform(0.2e-3, 0.5e-3), 14 if rng.random() < 0.25 else 12)
    logger = Logger(seconds, hz, bool(rng.random() < 0.5))
    paths = [KINDS[kind](robot.arm, rng, seconds) for kind in kinds]
    yardstick = Yardstick(robot, paths[2:], logger, sensors.sigma) if effects else None
    faults: dict[str, Fault] = {}
    seen: dict[str, float] = {}
    shown: dict[str, dict[str, float]] = {}
    for name in effects:
        if yardstick is not None:
            faults[name], seen[name] = choose(FAULTS[name], wanted, yardstick, rng)
            shown[name] = yardstick.by_joint(faults[name])
    logs = [sensors.log(f"{kind}_{k}", robot.arm, simulate(robot, list(faults.values()), path, logger, rng),
                        logger.hold, rng)
            for k, (kind, path) in enumerate(zip(kinds, paths, strict=True))]  # fmt: skip
    return IndependentCase(robot, faults, seen, shown, tuple(logs[:2]), tuple(logs[2:]))


def draw_robot(arm: Arm, rng: np.random.Generator) -> Robot:
    """A robot with production tolerances: masses 1.5 %, centres of mass 2 mm, gains 5 % and friction 25 % off."""
    n, made = len(arm.joints), nominal(arm)
    return replace(
        made,
        mass=made.mass * (1 + 0.015 * rng.standard_normal(n)),
        centre=made.centre + 0.002 * rng.standard_normal((n, 3)),
        stiffness=made.stiffness * rng.uniform(0.95, 1.05, n),
        damping=made.damping * rng.uniform(0.95, 1.05, n),
        viscous=made.viscous * rng.uniform(0.75, 1.25, n),
    )


class Yardstick:
    """Visibility of a fault: how much it changes the held-out logs of a robot, in sensor noises."""

    def __init__(self, robot: Robot, paths: Sequence[Path], logger: Logger, sigma: float) -> None:
        self.robot, self.paths, self.logger, self.sigma = robot, paths, logger, sigma
        self.without = self._positions([])

    def _positions(self, faults: list[Fault]) -> np.ndarray:
        return np.concatenate([simulate(self.robot, faults, path, self.logger).position for path in self.paths])

    def __call__(self, fault: Fault) -> float:
        """Root mean square change of position, of the joint where it is largest, in noises."""
        change = self._positions([fault]) - self.without
        return float(np.sqrt(np.mean(change**2, axis=0)).max() / self.sigma)

    def by_joint(self, fault: Fault) -> dict[str, float]:
        """Visibility of the fault on each of its joints alone; {} for a fault of the whole arm."""
        if fault.per_arm:
            return {}
        return {
            fault.arm.names[j]: self(type(fault)(fault.arm, np.array([j]), fault.draw, fault.size)) for j in fault.at
        }


def choose(kind: type[Fault], wanted: float, yardstick: Yardstick, rng: np.random.Generator) -> tuple[Fault, float]:
    """A fault on one to three joints with about the wanted visibility, and its visibility."""
    arm, found = yardstick.robot.arm, []
    for _ in range(ATTEMPTS):
        n = len(arm.joints)
        at = np.sort(rng.choice(n, rng.integers(1, 4), replace=False))
        found.append(sized(kind, arm, at, rng.random((n, 4)), wanted, yardstick))
        if _apart(found[-1][1], wanted) <= CLOSE:
            break
    return min(found, key=lambda one: _apart(one[1], wanted))


def sized(
    kind: type[Fault], arm: Arm, at: np.ndarray, shares: np.ndarray, wanted: float, yardstick: Yardstick
) -> tuple[Fault, float]:
    """The fault, with the size that gives about the wanted visibility: search by proportion, then by bisection."""
    low, high, size = 1e-4, 1.0, 0.05
    best: tuple[Fault, float] | None = None
    for _ in range(STEPS):
        fault = kind(arm, at, shares, size)
        seen = yardstick(fault)
        if best is None or _apart(seen, wanted) < _apart(best[1], wanted):
            best = fault, seen
        if _apart(seen, wanted) <= CLOSE or (size == 1.0 and seen < wanted):
            break
        low, high = (size, high) if seen < wanted else (low, size)
        size *= np.clip(wanted / max(seen, 1e-9), 0.1, 10)
        size = float(size) if low < size < high else (high if high == 1.0 else float(np.sqrt(low * high)))
    return best if best is not None else (kind(arm, at, shares, size), 0.0)


def _apart(seen: float, wanted: float) -> float:
    """Ratio of two visibilities, at least 1."""
    ratio = max(seen, 1e-9) / wanted
    return float(max(ratio, 1 / ratio))
