"""Payload: diagnosis of a load with the unloaded robot's friction known, and coverage of the interval of its mass.

    python -m benchmarks.payload [--cases 20] [--seed 0] [--jobs 2] [--shard I/N] [--out FILE.jsonl]
                                 [--rows FILE.jsonl ...] [--results DIR]

A simulated arm with Coulomb friction, whose URDF has masses up to 10 % and centres up to 10 mm off, is logged twice
without commands (positions and efforts, four recordings of 6 s): without a load, and with 1 to 3 kg up to 7 cm from its
flange. The unloaded logs are diagnosed first; the loaded logs are then diagnosed with that model, its friction and URDF
fixed. The
baseline is least squares of the mass: the effort residuals of the unloaded model, regressed on the efforts that 1 kg at
the flange adds.
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

from benchmarks.cases import COSTS, case_options, one_sentence, run_cases, save_results
from benchmarks.common import clopper_pearson, times
from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.io.cases import Cases
from embodiedreamer_gym.motions import MOTIONS
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.arms import TRUTH, arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.cases import SENSOR as SENSORS
from embodiedreamer_gym.standin.robot import StandIn
from embodiedreamer_gym.standin.span import span_of

ARM = "arm6"
POOR: dict[str, Any] = {"mass_error": 0.1, "com_error": 0.01, "gain_error": 0.05, "viscous_error": 0.25}
KINDS = ("multisine", "point_to_point", "teleoperation", "slow_ramps")  # the last two are held out
SENSOR: dict[str, Any] = SENSORS
MASS, BESIDE = (1.0, 3.0), 0.07  # kg, m
FRICTION = (0.04, 0.16)  # share of the joint's largest torque without a load
SECONDS = 6.0


def logs(robot: StandIn, seed: int) -> tuple[list[Recording], list[Recording]]:
    """Training and held-out recordings without commands; the same seed gives the same motions."""
    span = span_of(arm_urdf(ARM), arm_joints(ARM), arm_home(ARM), reach=0.7, speed=0.8)
    rng, taken = np.random.default_rng([seed, 1]), []
    for kind in KINDS:
        log = robot.record(MOTIONS[kind](span, rng, SECONDS), name=kind, hz=100.0, **SENSOR)
        taken.append(log.with_(command=None, velocity=None))
    return taken[:2], taken[2:]


def one_case(case: dict[str, Any]) -> dict[str, Any]:
    """Diagnose one robot without and with a load."""
    seed = case["seed"]
    rng = np.random.default_rng([seed, 0])
    servo, joints = asdict(TRUTH[ARM]), arm_joints(ARM)
    plain = StandIn(arm_urdf(ARM), joints, **servo, timestep=5e-4)
    torque = np.abs(np.concatenate([np.asarray(r.effort) for r in logs(plain, seed)[0]])).max(axis=0)
    friction = {"torque": torque * rng.uniform(*FRICTION, len(joints))}
    mass, direction = rng.uniform(*MASS), rng.standard_normal(3)
    place = BESIDE * rng.uniform() * direction / np.linalg.norm(direction)
    load = {"mass": np.array([mass]), **{axis: np.array([x]) for axis, x in zip("xyz", place, strict=True)}}
    model = nominal(servo, joints)
    sets = [
        logs(StandIn(arm_urdf(ARM), joints, **servo, effects={"coulomb_friction": friction, **more}, rng=np.random.default_rng(seed),
                     **POOR), seed)
        for more in ({}, {"payload": load})
    ]  # fmt: skip
    unloaded = diagnose(model, *sets[0], jobs=1).model
    loaded = diagnose(unloaded.with_fixed("friction", "urdf"), *sets[1], jobs=1)
    row = next((r for r in loaded.model.parameters().select("payload") if r.key.parameter == "mass"), None)
    return {
        "mass": mass, "place": place.tolist(), "friction": [e.name for e in unloaded.effects],
        "verdict": loaded.verdict, "effects": list(loaded.effects), "closest": list(loaded.closest),
        "fitted": row and row.value, "interval": row and row.interval,
        "least_squares": regressed(unloaded, sets[1][0]), "error": loaded.error,
    }  # fmt: skip


def nominal(servo: dict[str, Any], joints: tuple[str, ...]) -> RobotModel:
    """The model that a user would start from."""
    robot = {"urdf": "arm.urdf", "joints": list(joints), "end_effectors": ["tip"]}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "arm.urdf").write_text(arm_urdf(ARM))
        (Path(folder) / "model.json").write_text(
            json.dumps({"robot": robot, "rotor_inertia": list(servo["rotor_inertia"])})
        )
        return RobotModel.load(Path(folder) / "model.json")


def regressed(model: RobotModel, train: list[Recording]) -> float:
    """Mass, kg, by least squares on what one kg at the end effector adds to the efforts."""
    signals = Signals(model, train)
    one = model.with_effect(Payload(mass=dict.fromkeys(model.arms, 1.0)))
    left = signals.residuals(model)[0]
    added = left - signals.residuals(one)[0]
    return float(added @ left / (added @ added))


def masses_held(rows: Sequence[Mapping[str, Any]]) -> list[bool]:
    """For each case with an interval: whether the interval contains the true mass."""
    return [r["interval"][0] <= r["mass"] <= r["interval"][1] for r in rows if r["interval"]]


def mass_errors(rows: Sequence[Mapping[str, Any]], key: str) -> list[float]:
    """Relative error of the estimated mass, for each case that has one; key: "fitted" or "least_squares"."""
    return [abs(r[key] / r["mass"] - 1) for r in rows if r[key] is not None]


def table(rows: list[dict[str, Any]]) -> str:
    """One line per case, then the counts."""
    lines = [
        f"{'seed':>4} {'mass kg':>8} {'beside cm':>9} {'verdict':<16}{'effects':<28}{'fitted':>8} {'interval':>16} {'LS':>6}"
    ]
    for r in rows:
        interval = f"[{r['interval'][0]:.2f}, {r['interval'][1]:.2f}]" if r["interval"] else "-"
        fitted = f"{r['fitted']:.2f}" if r["fitted"] is not None else "-"
        lines.append(f"{r['seed']:>4} {r['mass']:>8.2f} {100 * np.linalg.norm(r['place']):>9.1f} {r['verdict']:<16}"
                     f"{','.join(r['effects'] or r['closest']):<28}{fitted:>8} {interval:>16} {r['least_squares']:>6.2f}")  # fmt: skip
    named = sum(r["effects"] == ["payload"] for r in rows)
    inside, (ours, theirs) = masses_held(rows), (mass_errors(rows, key) for key in ("fitted", "least_squares"))
    low, high = clopper_pearson(sum(inside), max(len(inside), 1))
    lines += [
        f"payload alone named: {named} of {len(rows)}",
        f"interval of the mass contains the true value: {sum(inside)} of {len(inside)} (95 % range {low:.0%} to {high:.0%})",
        f"error of the mass, median and largest: {np.median(ours or [np.nan]):.1%}, {max(ours, default=np.nan):.1%}; "
        f"least squares at the flange: {np.median(theirs):.1%}, {max(theirs):.1%}",
    ]
    return "\n".join(lines)


def shown(row: dict[str, Any]) -> str:
    """A finished case as one line."""
    return f"{row['seed']} {row['verdict']} {', '.join(row['effects'] or row['closest'])}"


def main() -> None:
    """Run the cases and print them."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--cases", type=times, default=20)
    parser.add_argument("--seed", type=int, default=0, help="seed of the first case")
    case_options(parser)
    a = parser.parse_args()
    cases = Cases({"benchmark": "payload"}, [{"seed": a.seed + k} for k in range(a.cases)])
    with one_sentence():
        rows = run_cases(a, cases, one_case, a.out, a.rows, shown)
    print(table(rows))
    kept = [{key: value for key, value in row.items() if key not in COSTS} for row in rows]
    save_results(a, cases, rows, [row["seed"] for row in rows], {"rows": kept})


if __name__ == "__main__":
    main()
