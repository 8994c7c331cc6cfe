"""Null test: the plant at 240 and 250 Hz compared with another engine at 10 kHz, for the same faultless robot.

The difference comes from the time step and from the unknown command between the samples of a log; a verdict must not
depend on smaller differences. Position in mrad rms (thousandths of a normalised gripper's stroke), torque rms in units
of a sensor noise of 2 % of the torque at a servo error of 0.05 rad. In the first two tables the model gets the commands
of a 1 kHz log. In the third, the robot follows the motion itself ("continuous"), a line between the logged commands
("linear"), or the last of them ("hold"); the model uses "linear" or "hold".
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import save
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.motions import Motion, Span, multisine, point_to_point, teleoperation
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from embodiedreamer_gym.standin.arms import TRUTH, arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.cases import ALOHA_HOME
from embodiedreamer_gym.standin.robot import StandIn
from embodiedreamer_gym.standin.span import span_of

ROBOTS = ("arm6", "arm6b", "arm7", "aloha")
SECONDS = 4.0
PLANT_RATES = (240, 250)  # Hz
FINE = 1e-4  # s, step of the other engine
DENSE = 1000.0  # Hz, a log dense enough for its command to count as continuous
TARGET = (0.1, 0.2)  # mrad, sensor noises
FRICTION_TARGET = 0.3  # mrad
FRICTION = 0.2  # Coulomb friction as a share of the torque at a servo error of 0.05 rad
EFFORT_NOISE = 0.02
RULES = (("continuous", "linear"), ("continuous", "hold"), ("linear", "linear"), ("hold", "hold"))


@dataclass(frozen=True)
class Twin:
    """A faultless robot in both engines: the model, a function that builds its stand-in, and its joint ranges."""

    model: RobotModel
    build: Callable[..., StandIn]
    span: Span


def twin(robot: str) -> Twin:
    """A stand-in arm, or the ALOHA pair."""
    if robot == "aloha":
        model = RobotModel.load("aloha")
        shared: dict[str, Any] = {"normalised": model.normalised, "end_effector_links": model.end_effectors}
        centre = np.array(ALOHA_HOME * 2)
        span = span_of(model.urdf, model.joints, centre, 0.5, 0.6, model.normalised)
        urdf: Any = model.urdf
    else:
        urdf, shared = arm_urdf(robot), {}
        model = arm_model(robot)
        span = span_of(urdf, model.joints, arm_home(robot))
    servo = {g: getattr(model, g) for g in ("stiffness", "damping", "rotor_inertia", "viscous_friction")}

    def build(effects: dict[str, dict[str, Any]] | None = None, timestep: float = FINE) -> StandIn:
        return StandIn(urdf, model.joints, **servo, effects=effects, timestep=timestep, **shared)

    return Twin(model, build, span)


def arm_model(arm: str) -> RobotModel:
    """The model of a stand-in arm with its true servo."""
    servo = {k: list(v) for k, v in asdict(TRUTH[arm]).items()}
    data = {
        "robot": {"urdf": f"{arm}.urdf", "joints": list(arm_joints(arm)), "end_effectors": ["tip"]},
        "servo": {k: servo.pop(k) for k in ("stiffness", "damping")},
        **servo,
    }
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{arm}.urdf").write_text(arm_urdf(arm))
        path = Path(folder) / f"{arm}.json"
        path.write_text(json.dumps(data))
        return RobotModel.load(path)


def with_effect(pair: Twin, effect: str, values: dict[str, Any]) -> tuple[RobotModel, dict[str, dict[str, Any]]]:
    """The model with an effect, and the same effect in the stand-in's form; values: parameter -> number or array."""
    model, named, given = pair.model, {}, {}
    for parameter in CATALOGUE[effect].parameters:
        names = model.joints if parameter.per == "joint" else model.arms
        array = np.full(len(names), np.asarray(values[parameter.name], float))
        given[parameter.name] = array
        named[parameter.name] = dict(zip(names, array.tolist(), strict=True))
    return model.with_(effects=(CATALOGUE[effect](**named),)), {effect: given}


def known(recording: Recording) -> Recording:
    """The log with nearly zero noise declared, so that the initial state is estimated from few samples."""
    n = len(recording.joints)
    return recording.with_(noise=np.full(n, 1e-5), quantum=np.zeros(n))


def error(
    model: RobotModel, standin: StandIn, recording: Recording, rate: float, hold: str = "linear"
) -> tuple[float, float]:
    """Rms errors of the model's free run: position in mrad, torque in sensor noises."""
    run = simulate(model, known(recording), dt=1.0 / rate, hold=hold)
    position = recording.position - run.position
    torque = (recording.effort - run.torque) / (EFFORT_NOISE * standin.effort_scale)
    return 1e3 * float(np.sqrt(np.mean(position**2))), float(np.sqrt(np.mean(torque**2)))


def motions(span: Span, seconds: float = SECONDS) -> list[Motion]:
    """A multisine and fast moves from pose to pose."""
    return [make(span, np.random.default_rng(0), seconds) for make in (multisine, point_to_point)]


@dataclass(frozen=True)
class Row:
    """One line of a table."""

    robot: str
    motion: str
    what: str
    position: float
    torque: float
    target: tuple[float, float] | None = None

    @property
    def met(self) -> bool:
        """Whether the target, if there is one, is met."""
        return self.target is None or (self.position <= self.target[0] and self.torque <= self.target[1])

    def __str__(self) -> str:
        mark = "" if self.target is None else "  ok" if self.met else "  MISSED"
        names = f"{self.robot:<7} {self.motion:<15} {self.what:<44}"
        return f"{names} {self.position:>8.3f} {self.torque:>8.3f}{mark}"


def engines(robot: str, seconds: float = SECONDS, friction: bool = False) -> Iterator[Row]:
    """Both plant rates compared with the other engine; the command is known at all times."""
    pair = twin(robot)
    model, effects = pair.model, {}
    if friction:
        size = np.where(np.array(model.units) == "rad", FRICTION * pair.build().effort_scale, 0.0)
        model, effects = with_effect(pair, "coulomb_friction", {"torque": size})
    standin = pair.build(effects)
    target = (FRICTION_TARGET, np.inf) if friction else TARGET
    for motion in motions(pair.span, seconds):
        log = standin.record(motion, hz=DENSE)
        for rate in PLANT_RATES:
            what = f"plant at {rate} Hz{', Coulomb friction' if friction else ''}"
            yield Row(robot, motion.kind, what, *error(model, standin, log, rate), target)


def between_samples(robot: str = "arm6", seconds: float = SECONDS) -> Iterator[Row]:
    """Errors with a sparse log, for each way in which robot and model use the commands between samples."""
    pair = twin(robot)
    standin = pair.build()
    kinds = [*motions(pair.span, seconds), teleoperation(pair.span, np.random.default_rng(0), seconds)]
    for rate in (100.0, 30.0):
        for robots, rule in RULES:
            for motion in kinds:
                log = standin.record(motion, hz=rate, command_known=robots)  # type: ignore[arg-type]
                what = f"{rate:g} Hz log, robot {robots}, model {rule}"
                yield Row(robot, motion.kind, what, *error(pair.model, standin, log, PLANT_RATES[0], rule))


def main(arguments: list[str] | None = None) -> int:
    """Print the tables; returns 1 when a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    print(f"{'robot':<7} {'motion':<15} {'':<44} {'mrad':>8} {'torque':>8}")
    for table in (
        *(engines(r, chosen.seconds) for r in chosen.robots),
        *(engines(r, chosen.seconds, friction=True) for r in chosen.robots),
        between_samples(seconds=chosen.seconds),
    ):
        for row in table:
            print(row, flush=True)
            rows.append({**asdict(row), "met": row.met})
    missed = sum(not row["met"] for row in rows)
    print(f"{missed} targets missed")
    save(rows, chosen.out)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
