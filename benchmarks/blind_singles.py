"""Blind singles: robots with one hidden effect each, made in another engine, and faultless ones with wrong masses.

python -m benchmarks.blind_singles [--draws 2] [--nulls 10] [--arm arm6] [--seed 0] [--out FILE.json]

The diagnoser gets recordings, a URDF and nominal gains; the truth is compared afterwards. A finished case is kept in
--out and not run again. Beside it: always naming Coulomb friction.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import beta

from benchmarks.common import pin_threads, save
from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import draw_case


def run_case(effect: str | None, arm: str, seed: int) -> dict:
    """Draw one case, write it as a user's files, diagnose it, and set the answer beside the truth."""
    rng = np.random.default_rng([seed, sum(map(ord, effect or "null"))])
    case = draw_case(effect, arm, rng)
    with tempfile.TemporaryDirectory() as folder:
        model = RobotModel.load(case.write(folder))
        found = diagnose(model, load_recordings(f"{folder}/train"), load_recordings(f"{folder}/test"))
    truth = sorted({joint for values in case.truth.get("values", {}).values() for joint in values})
    if effect is None:
        points = float(found.verdict in ("nothing_missing", "unknown"))
    elif found.verdict == "ambiguous":
        points = 0.5 * (effect in found.effects)
    else:
        points = float(found.verdict == "missing" and found.best == effect)
    return {
        "effect": effect, "seed": seed, "verdict": found.verdict, "named": list(found.effects), "points": points,
        "joints": list(found.joints.get(effect or "", ())), "true_joints": truth, "error": found.error,
        "p_value": found.p_value, "seconds": found.seconds, "rollouts": found.rollouts,
    }  # fmt: skip


def interval(hits: float, of: int) -> tuple[float, float]:
    """Clopper-Pearson 95 % interval of a share."""
    low = beta.ppf(0.025, hits, of - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, of - hits) if hits < of else 1.0
    return float(low), float(high)


def main() -> None:
    """Print one line per case, then the shares."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=2)
    parser.add_argument("--nulls", type=int, default=10)
    parser.add_argument("--arm", default="arm6")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    pin_threads()
    rows = json.loads(arguments.out.read_text()) if arguments.out and arguments.out.is_file() else []
    done = {(row["effect"], row["seed"]) for row in rows}
    wanted = [(None, arguments.seed + k) for k in range(arguments.nulls)]
    wanted += [(name, arguments.seed + k) for name in CATALOGUE for k in range(arguments.draws)]
    for effect, seed in wanted:
        if (effect, seed) not in done:
            rows.append(run_case(effect, arguments.arm, seed))
            save(rows, arguments.out)
        row = next(r for r in rows if (r["effect"], r["seed"]) == (effect, seed))
        error = {k: f"{1e3 * v:.2f}" for k, v in row["error"].items() if v is not None}
        print(f"{effect or 'null':<30}{row['verdict']:<16}{', '.join(row['named']) or '-':<46}"
              f"{error['calibrated']:>7} -> {error.get('with_effect', '-'):>6} mrad {row['rollouts']:>5} rollouts "
              f"{row['seconds']:5.0f} s", flush=True)  # fmt: skip
    singles = [r for r in rows if r["effect"]]
    nulls = [r for r in rows if not r["effect"]]
    points = sum(r["points"] for r in singles)
    accused = sum(r["verdict"] in ("missing", "ambiguous") for r in nulls)
    low, high = interval(points, len(singles))
    print(
        f"\nright name (a tie counts half): {points:g} of {len(singles)} = {points / max(len(singles), 1):.0%} [{low:.0%}, {high:.0%}]"
    )
    low, high = interval(accused, len(nulls))
    print(f"accusations of faultless robots: {accused} of {len(nulls)} [{low:.0%}, {high:.0%}]")
    named = [r for r in singles if r["points"] == 1]
    joints = sum(r["joints"] == r["true_joints"] for r in named)
    print(f"joints exactly right, of the rightly named: {joints} of {len(named)}")
    fall = [1 - r["error"]["with_effect"] / r["error"]["calibrated"] for r in named]
    print(
        f"fall of the held-out error, median: {np.median(fall):.0%}; seconds, median: {np.median([r['seconds'] for r in rows]):.0f}"
    )
    coulomb = sum(r["effect"] == "coulomb_friction" for r in singles)
    print(f"baseline: always naming Coulomb friction is right in {coulomb} of {len(singles)} and accuses every null")


if __name__ == "__main__":
    main()
