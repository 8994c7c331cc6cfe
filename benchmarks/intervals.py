"""Coverage of the 95 % intervals of a calibration, for white and for coloured noise.

    python -m benchmarks.intervals [--fits 50] [--jobs 2] [--shard I/N] [--out FILE.jsonl] [--rows FILE.jsonl ...] [--results DIR]

The 7-joint arm and the 21 unknowns of benchmarks.calibration; least squares from initial values off by up to a factor
of 1.3. Each fit has its own motion and its own noise of 0.5 mrad: white, or first-order autoregressive at 50 Hz.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.calibration import ARM, FRICTION, NOISE, RATE, SECONDS, play, start_from, true_model, unknowns
from benchmarks.cases import COSTS, case_options, one_sentence, run_cases, save_results
from benchmarks.common import clopper_pearson
from embodiedreamer_gym.io.cases import Cases
from embodiedreamer_gym.motions import multisine
from embodiedreamer_gym.phys_aligner import calibrate
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.arms import arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.span import span_of

OUT = Path("build/benchmarks/intervals.jsonl")
COLOURS = {"white": 0.0, "AR(1) 0.80": 0.8, "AR(1) 0.90": 0.9, "AR(1) 0.95": 0.95}
GROUPS = ("stiffness", "damping", "coulomb_friction")
OFF = 1.3


def noise(rho: float, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Stationary noise (T, n) of unit standard deviation; neighbouring samples have correlation rho."""
    fresh = rng.standard_normal(shape)
    fresh[1:] *= np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], fresh, axis=0))


def fit(truth: RobotModel, colour: str, seed: int) -> dict[str, Any]:
    """One fit; sides: -1 (truth below the interval), 0 (inside), 1 (above) or None (no interval)."""
    span = span_of(arm_urdf(ARM), arm_joints(ARM), arm_home(ARM), reach=0.7, speed=0.8)
    motion = multisine(span, np.random.default_rng(100 + seed), SECONDS)
    rng = np.random.default_rng([seed, int(100 * COLOURS[colour])])
    samples = (int(SECONDS * RATE) + 1, truth.n)
    log = play(truth, motion, NOISE * noise(COLOURS[colour], samples, rng))
    found = calibrate(start_from(truth, seed, OFF), [log], scan=False)
    rows = found.model.parameters().select(*GROUPS)
    sides = [
        None if row.interval is None else int(np.sign(value - np.clip(value, *row.interval)))
        for row, value in zip(rows, unknowns(truth), strict=True)
    ]
    width = [None if r.interval is None else (r.interval[1] - r.interval[0]) / 2 / r.value for r in rows]
    return {"sides": sides, "width": width, "rollouts": found.rollouts}


def fits_of(rows: Sequence[Mapping[str, Any]], colour: str, key: str) -> np.ndarray:
    """Sides or widths (fits, parameters) of the fits with one kind of noise; NaN where there is no interval."""
    return np.array([row[key] for row in rows if row["job"].startswith(f"{colour} | ")], float)


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Coverage by noise and group."""
    title = f"{'noise':<12}{'parameters':<18}{'inside':>12}{'coverage':>10}{'95 % range':>18}{'none':>6}"
    lines = [title + f"{'half-width %':>14}"]
    for colour in COLOURS:
        sides, width = fits_of(rows, colour, "sides"), fits_of(rows, colour, "width")
        if not len(sides):
            continue
        joints = len(FRICTION)
        blocks = [(g, slice(i * joints, (i + 1) * joints)) for i, g in enumerate(GROUPS)]
        for group, columns in [*blocks, ("all", slice(None))]:
            own = sides[:, columns]
            known = np.isfinite(own)
            hits, trials = int((own == 0).sum()), int(known.sum())
            low, high = clopper_pearson(hits, trials)
            lines.append(
                f"{colour:<12}{group:<18}{f'{hits}/{trials}':>12}{hits / max(trials, 1):>10.1%}"
                f"{f'{low:.1%} .. {high:.1%}':>18}{int((~known).sum()):>6}"
                f"{100 * np.nanmedian(width[:, columns]):>14.2f}"
            )
    return "\n".join(lines)


def coverage(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Noise -> share (%) of the intervals that contain the true value."""
    sides = {colour: fits_of(rows, colour, "sides") for colour in COLOURS}
    return {colour: float(100 * np.mean(own[np.isfinite(own)] == 0)) for colour, own in sides.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--fits", type=int, default=50, help="fits for each kind of noise")
    case_options(parser, OUT)
    options = parser.parse_args()
    jobs = [f"{colour} | {seed}" for seed in range(options.fits) for colour in COLOURS]
    with tempfile.TemporaryDirectory() as folder:
        truth = true_model(Path(folder))

        def work(case: Mapping[str, Any]) -> dict[str, Any]:
            colour, seed = case["job"].split(" | ")
            return fit(truth, colour, int(seed))

        cases = Cases({"benchmark": "intervals", "arm": ARM, "off": OFF}, [{"job": job} for job in jobs])
        with one_sentence():
            rows = run_cases(options, cases, work, options.out or OUT, options.rows, itemgetter("job"))
    print("", table(rows), sep="\n")
    kept = [{key: value for key, value in row.items() if key not in COSTS} for row in rows]
    save_results(options, cases, rows, list(range(options.fits)), {"rows": kept})


if __name__ == "__main__":
    main()
