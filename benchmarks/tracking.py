"""Tracking error of an arm with hidden effects, with and without commands computed by a model diagnosed from its logs.

python -m benchmarks tracking [--seeds 5] [--first-seed 0] [--named] [--out FILE.json] [--add FILE.json ...]

Each seed draws a stand-in arm (MuJoCo, six joints) with dry friction, a load at its tip, a command delay and a torque
limit of the drives (sufficient to carry the load), and with errors of masses and gains. `diagnose` finds its effects
from four logs of 4 s; with --named, `calibrate` is given the names of the effects, not their sizes. Then the arm
follows motions that are not in the logs, at 50 commands per second, with encoder noise: once unchanged, and once with
0.3 kg more at its tip, which the model does not include. The error is the root mean square of a joint's position minus
the desired one.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import pin_threads, save

ARM, HZ, LOAD = "arm6", 50.0, 0.3  # actions per second; kg
EFFECTS = ("coulomb_friction", "payload", "command_delay", "torque_saturation")
LEARNT, HELD_OUT = ("multisine", "point_to_point"), ("teleoperation", "slow_ramps")
FOLLOWED, SECONDS = ("teleoperation", "point_to_point"), 5.0
REACH, SPEED = 0.6, 0.6
SPARE = 1.2  # least torque of the drives, relative to the torque that holds the load in any pose
FREE, LOADED = "free motion", f"{LOAD} kg more"


class Arm:
    """One stand-in arm with its hidden effects."""

    def __init__(self, seed: int) -> None:
        from embodiedreamer_gym.motions import MOTIONS
        from embodiedreamer_gym.standin.arms import TRUTH, arm_home, arm_joints, arm_urdf
        from embodiedreamer_gym.standin.effect_sizes import draw_values
        from embodiedreamer_gym.standin.robot import StandIn
        from embodiedreamer_gym.standin.span import span_of

        self.seed, self.urdf, self.joints, self.servo = seed, arm_urdf(ARM), arm_joints(ARM), asdict(TRUTH[ARM])
        self.motions = MOTIONS
        self.span = span_of(self.urdf, self.joints, arm_home(ARM), REACH, SPEED)
        nominal = StandIn(self.urdf, self.joints, **self.servo, timestep=5e-4)
        rng = np.random.default_rng([seed, 0])
        shown = [MOTIONS[kind](self.span, rng, 4.0) for kind in LEARNT]
        every = list(range(len(self.joints)))
        self.effects = {name: draw_values(name, nominal, shown, self.span, rng, 1.0, every, [0]) for name in EFFECTS}
        poses = self.span.centre + self.span.reach * rng.uniform(-1, 1, (200, len(self.joints)))
        needed = np.abs(self.robot(LOAD).gravity_torque(poses)).max(0) + self.effects["coulomb_friction"]["torque"]
        limit = self.effects["torque_saturation"]["limit"]
        self.effects["torque_saturation"]["limit"] = np.where(limit > 0, np.maximum(limit, SPARE * needed), 0.0)

    def robot(self, more: float = 0.0, timestep: float = 5e-4) -> Any:
        """The arm with `more` kg at its tip."""
        from embodiedreamer_gym.standin.cases import IMPERFECT
        from embodiedreamer_gym.standin.robot import StandIn

        payload = {**self.effects["payload"], "mass": self.effects["payload"]["mass"] + more}
        effects = {**self.effects, "payload": payload}
        rng = np.random.default_rng([self.seed, 1])
        return StandIn(self.urdf, self.joints, **self.servo, effects=effects, rng=rng, timestep=timestep, **IMPERFECT)

    def logs(self) -> tuple[Any, Any]:
        """Training and held-out recordings."""
        from embodiedreamer_gym.recordings import Recordings
        from embodiedreamer_gym.standin.cases import SENSOR

        robot, rng = self.robot(timestep=1e-4), np.random.default_rng([self.seed, 2])
        made = [
            robot.record(self.motions[kind](self.span, rng, 4.0), name=f"{kind}-{i}", command_known="linear",
                         declare="linear", **SENSOR)
            for i, kind in enumerate((*LEARNT, *HELD_OUT))
        ]  # fmt: skip
        return Recordings(made[: len(LEARNT)]), Recordings(made[len(LEARNT) :])

    def model(self, named: bool) -> Any:
        """The model that a user gets from the logs."""
        from embodiedreamer_gym import RobotModel, calibrate, diagnose

        with tempfile.TemporaryDirectory() as folder:
            urdf = Path(folder) / "arm.urdf"
            urdf.write_text(self.urdf)
            text = {"robot": {"urdf": "arm.urdf", "joints": list(self.joints), "end_effectors": ["tip"]},
                    "servo": {key: list(self.servo[key]) for key in ("stiffness", "damping")},
                    "rotor_inertia": list(self.servo["rotor_inertia"]),
                    "viscous_friction": list(self.servo["viscous_friction"]), "effects": []}  # fmt: skip
            save(text, Path(folder) / "arm.json")
            model = RobotModel.load(Path(folder) / "arm.json")
            train, test = self.logs()
            if not named:
                found = diagnose(model, train, test, max_effects=len(EFFECTS), jobs=1)
                return found.model
            for name in EFFECTS:
                model = model.with_effect(name)
            return calibrate(model, train).model


def followed(arm: Arm, robot: Any, model: Any, mode: str, motion: Any) -> np.ndarray:
    """Root mean square errors (n,) rad of the joints when the arm follows a motion."""
    from embodiedreamer_gym.standin.cases import SENSOR
    from embodiedreamer_gym.tracking import Tracker

    tracker, rng, period = Tracker(model, HZ, mode), np.random.default_rng([arm.seed, 3]), 1.0 / HZ
    steps = round(period / robot.timestep)
    wanted = motion(np.arange(round(motion.duration * HZ) + 1) * period)
    engine = robot.engine
    engine.begin(wanted[0])
    tracker.reset(engine.encoders(), wanted[0])
    sent, errors = [wanted[0]], []
    for k in range(1, len(wanted)):
        read = engine.encoders() + SENSOR["noise"] * rng.standard_normal(len(wanted[0]))
        read = np.round(read / SENSOR["quantum"]) * SENSOR["quantum"]
        tracker.preview(wanted[k : k + 10])  # as with a policy's chunk or a planned motion
        sent.append(tracker.command(wanted[k], read))
        times = np.arange(len(sent)) * period
        commands = np.array(sent)
        engine.advance(lambda t, x=times, y=commands: np.stack([np.interp(t, x, one) for one in y.T], axis=1), steps)
        errors.append(engine.encoders() - wanted[k])
    return np.sqrt(np.mean(np.square(errors), axis=0))


def one_seed(seed: int, named: bool) -> list[dict[str, Any]]:
    """A row for each load, motion and mode."""
    from embodiedreamer_gym.tracking import MODES

    arm = Arm(seed)
    model = arm.model(named)
    print(f"seed {seed}: the model has {', '.join(effect.name for effect in model.effects) or 'no effect'}", flush=True)
    rows, rng = [], np.random.default_rng([seed, 4])
    motions = [arm.motions[kind](arm.span, rng, SECONDS) for kind in FOLLOWED]
    for load, more in ((FREE, 0.0), (LOADED, LOAD)):
        robot = arm.robot(more)
        for motion in motions:
            for mode in MODES:
                errors = followed(arm, robot, model, mode, motion)
                rows.append(
                    {"seed": seed, "load": load, "motion": motion.kind, "mode": mode, "errors": errors.tolist()}
                )
    return rows


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Load -> mode -> figures of the errors over motions.

    quartiles (3,): quartiles over seeds of the median over joints, mrad; joints (n,): medians over seeds, mrad; share:
    error relative to that of mode off; below, of: number of joints with at most a third of that error, and of all
    joints.
    """
    from embodiedreamer_gym.tracking import MODES

    seeds, loads = sorted({row["seed"] for row in rows}), list(dict.fromkeys(row["load"] for row in rows))
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for load in loads:
        errors = {
            mode: np.array([
                np.sqrt(np.mean([np.square(r["errors"]) for r in rows if (r["seed"], r["load"], r["mode"]) == (s, load, mode)], axis=0))
                for s in seeds
            ]) for mode in MODES
        }  # fmt: skip
        found[load] = {
            mode: {"quartiles": np.percentile(np.median(1e3 * own, axis=1), [25, 50, 75]), "joints": np.median(1e3 * own, axis=0),
                   "share": float(np.median(np.median(own / errors["off"], axis=1))),
                   "below": int((own <= errors["off"] / 3).sum()), "of": own.size}
            for mode, own in errors.items()
        }  # fmt: skip
    return found


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Medians over seeds, motions and joints, with quartiles over seeds, and the error relative to that of mode off."""
    lines = [
        "| | mode | median of joints, mrad (quartiles over seeds) | each joint, mrad | share of off |",
        "|---|---|---|---|---|",
    ]
    for load, modes in summary(rows).items():
        for mode, one in modes.items():
            low, middle, high = one["quartiles"]
            joints = " ".join(f"{error:.1f}" for error in one["joints"])
            lines.append(f"| {load} | {mode} | {middle:.1f} ({low:.1f} .. {high:.1f}) | {joints} | {one['share']:.2f} | "
                         f"{one['below']} of {one['of']} |")  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--named", action="store_true")
    parser.add_argument("--out", type=Path, help="rows as JSON; those of other files are added by --add")
    parser.add_argument("--add", type=Path, nargs="*", default=[])
    a = parser.parse_args()
    pin_threads()
    rows: list[dict[str, Any]] = [row for path in a.add for row in json.loads(path.read_text())]
    for seed in range(a.first_seed, a.first_seed + a.seeds):
        rows += one_seed(seed, a.named)
        save(rows, a.out)
    print(report(rows))


if __name__ == "__main__":
    main()
