"""Ablation of VisAligner: each part is switched off in turn, with the same episodes, steps, seed and held-out episodes.

python -m benchmarks.vis_ablation --train FILMS --test FILMS --out DIR [--steps 3000] [--only NAME ...] [--chunks N] [--json FILE]

Films: folders of `embodiedreamer standin film`. Each variant is trained in DIR/<name>, so that an interrupted study
resumes, and its measures are kept in DIR/<name>.json; the table has all variants with measures. `no masks` is similar
to the paper's Table 2: the objects are erased from the simulated picture, so that nothing shows where they are.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.common import save
from embodiedreamer_gym.io.files import write_json
from embodiedreamer_gym.vis_aligner import load_episodes
from embodiedreamer_gym.vis_aligner.bench import make_bench
from embodiedreamer_gym.vis_aligner.held_out import AFTER_TRUE, CLOSED, evaluate_aligner
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs
from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train

FULL = "everything"
COLUMNS = ("psnr", "ssim", "psnr.moving", "psnr.arm and objects", "psnr.objects", "iou.objects", "colour_shift")


def variants(steps: int) -> dict[str, tuple[LeanConfig, TrainingConfig]]:
    """Network and training of each variant."""
    config, training = LeanConfig(), TrainingConfig(steps=steps)
    without = {"masks": "no masks", "depth": "no depth", "anchor": "no anchor", "plate": "no plate",
               "at_reference": "no view at the reference", "reproject": "no reprojection",
               "gallery": "no gallery of the robot"}  # fmt: skip
    found = {FULL: (config, training)}
    for name, label in without.items():
        found[label] = replace(config, inputs=replace(Inputs(), **{name: False})), training
    found["bench unknown in training"] = config, replace(training, bench_share=0.0)
    found["no gate"] = replace(config, gate=False), training
    found["no own outputs in training"] = config, replace(training, own_reference_share=0.0)
    return found


def run(name: str, config: LeanConfig, training: TrainingConfig, a: argparse.Namespace) -> dict[str, Any]:
    """Train a variant and measure it on each held-out episode."""
    torch.manual_seed(training.seed)
    aligner = LeanAligner(Lean(config))

    def show(stage: str, step: int, of: int | None = None, /, **values: Any) -> None:
        if step % 500 == 0:
            print(f"{name}, {stage}: step {step} of {of}, loss {values.get('loss', '')}", flush=True)

    episodes = load_episodes([a.train])
    train(aligner, episodes, training, a.out / name, show)
    bench = make_bench(episodes)
    rows = []
    for episode in load_episodes([a.test]):
        found = evaluate_aligner(aligner, episode, a.chunks, bench).measures
        rows.append({clip: {c: measured[c] for c in COLUMNS} for clip, measured in found.items()})
    return {"name": name, "steps": training.steps, "episodes": rows}


def means(result: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Means of a variant over held-out episodes, for each kind of frames."""
    rows = result["episodes"]
    return {
        kind: {
            c: float(np.nanmean([np.nan if row[kind][c] is None else row[kind][c] for row in rows])) for c in COLUMNS
        }
        for kind in rows[0]
    }


def table(results: Sequence[dict[str, Any]]) -> str:
    """Means over held-out episodes of every variant, after true frames and in the closed loop, and of baselines."""
    lines = [f"{'':<42}{'':<20}" + "".join(f"{c.removeprefix('psnr.')[:12]:>13}" for c in COLUMNS)]
    for result in results:
        found = means(result)
        for clip in [AFTER_TRUE, CLOSED] if result["name"] != FULL else found:
            lines.append(f"{result['name']:<42}{clip:<20}" + "".join(f"{found[clip][c]:>13.3f}" for c in COLUMNS))
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the variants that are missing, then print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.vis_ablation", description=str(__doc__).splitlines()[0])
    parser.add_argument("--train", type=Path, required=True)
    parser.add_argument("--test", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--chunks", type=int, help="chunks of each held-out episode (default: all)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="variants")
    parser.add_argument("--json", type=Path, metavar="FILE", help="means of the table as JSON")
    a = parser.parse_args(arguments)
    torch.set_num_threads(1)
    a.out.mkdir(parents=True, exist_ok=True)
    for name, (config, training) in variants(a.steps).items():
        path = a.out / f"{name}.json"
        if not path.is_file() and (not a.only or name in a.only):
            write_json(run(name, config, training, a), path)
    results = [json.loads(p.read_text()) for n in variants(a.steps) if (p := a.out / f"{n}.json").is_file()]
    print(table(results))
    save({one["name"]: means(one) for one in results}, a.json)


if __name__ == "__main__":
    main()
