"""Real XL330: one Dynamixel servo with a pendulum at two firmware gains; missing effects, by gain and in a joint fit.

python -m benchmarks.real_xl330 [--data ../shared/data/bam_xl330] [--out FILE.json]

Two motions are for training and two for test, then exchanged; at gain 100, at gain 400 (4 times the stiffness), and
with both in one fit. The diagnosis is compared with friction effects and a sagging supply added by hand, and with the
same servo simulated and fitted without the package (benchmarks/pendulum.py). Data: github.com/Rhoban/bam, commit
af22604 (Apache-2.0), not shipped. Errors in mrad.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.common import data_folder, folder, save
from benchmarks.pendulum import COULOMB, EQUAL, GEARS, SAG, Pendulum
from embodiedreamer_gym.diagnosis import add_effect, diagnose
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.recordings import Recordings, load_recordings
from embodiedreamer_gym.robot import RobotModel

GAINS = ((100,), (400,), (100, 400))
HALVES = (("lift_and_drop", "sin_sin"), ("sin_time_square", "up_and_down"))
PLAIN = ("coulomb_friction", "stribeck_friction", "load_friction")
SAGGING = "load_friction and supply_sag"
DIRECT = {
    "direct, Coulomb": (COULOMB, {}),
    "direct, gears": (GEARS, EQUAL),
    "direct, gears and sag": ((*GEARS, *SAG), EQUAL),
}


def load(data: Path, gains: tuple[int, ...], kinds: tuple[str, ...]) -> Recordings:
    """Logs of these gains and motions; gains are relative to the first one."""
    names = [data / f"kp{gain}_{kind}_1.csv" for gain in gains for kind in kinds]
    return load_recordings(*names, gains={f"kp{gain}_*": gain / gains[0] for gain in gains})


def study(data: Path, gains: tuple[int, ...], kinds: tuple[str, ...], others: tuple[str, ...]) -> dict:
    """Diagnosis, plain friction effects and direct simulations of one split."""
    model, train, test = RobotModel.load(data / "pendulum.json"), load(data, gains, kinds), load(data, gains, others)
    found = diagnose(model, train, test, jobs=1)
    errors = {key: 1e3 * (found.error[key] or float("nan")) for key in ("nominal", "calibrated", "with_effect")}
    by_hand = {name: add_effect(model, name, train, test).after.model for name in PLAIN}
    by_hand[SAGGING] = add_effect(by_hand["load_friction"], "supply_sag", train, test).after.model
    errors |= {name: 1e3 * evaluate(fitted, test).error for name, fitted in by_hand.items()}
    stiffness = {"diagnosis": float(found.model.stiffness[0]), SAGGING: float(by_hand[SAGGING].stiffness[0])}
    learnt, judged = (Pendulum.of(logs, data / "pendulum.urdf") for logs in (train, test))
    for name, (free, equal) in DIRECT.items():
        values = learnt.fit(free, equal)
        errors[name], stiffness[name] = 1e3 * judged.rms(values), values["stiffness"]
    row = {"gains": gains, "learnt": kinds, "verdict": found.verdict, "effects": list(found.effects), "closest": found.closest,
           "error": errors, "stiffness": stiffness, "seconds": found.seconds}  # fmt: skip
    print(f"\ngain {' and '.join(map(str, gains))}, trained on {', '.join(kinds)}: {found.sentence}")
    print("   ".join(f"{name} {value:.1f}" for name, value in errors.items()), flush=True)
    return row


def ratios(rows: list[dict]) -> dict[str, list[float]]:
    """Ratio of the stiffness at gain 400 to that at gain 100, each fitted alone, for each split."""
    of = {(row["gains"], row["learnt"]): row["stiffness"] for row in rows}
    return {
        name: [of[(400,), kinds][name] / of[(100,), kinds][name] for kinds in HALVES] for name in rows[0]["stiffness"]
    }


def whole(data: Path) -> dict[str, float]:
    """The same ratio for direct fits to all four motions of each gain."""
    result = {}
    for name, (free, equal) in DIRECT.items():
        fits = [Pendulum.of(load(data, (gain,), HALVES[0] + HALVES[1]), data / "pendulum.urdf").fit(free, equal)
                for gain in (100, 400)]  # fmt: skip
        result[name] = fits[1]["stiffness"] / fits[0]["stiffness"]
    return result


def main() -> None:
    """Print a line for each split, and the ratio of the stiffnesses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=folder, default=str(data_folder("bam_xl330")))
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    rows = [study(arguments.data, gains, *halves) for halves in (HALVES, HALVES[::-1]) for gains in GAINS]
    alone, together = ratios(rows), whole(arguments.data)
    print("\nstiffness at gain 400 over that at gain 100, each fitted alone (the firmware's ratio is 4):")
    for name, values in alone.items():
        more = f", all motions {together[name]:.2f}" if name in together else ""
        print(f"  {name}: {', '.join(f'{value:.2f}' for value in values)}{more}")
    save({"splits": rows, "ratio": alone, "ratio_of_all_motions": together}, arguments.out)


if __name__ == "__main__":
    main()
