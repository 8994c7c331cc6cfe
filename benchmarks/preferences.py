"""Preference learning: cycles of rollouts and fine-tuning on the twin of PutCupOnMat, compared with cloning and PPO.

python -m benchmarks.preferences [--seeds 0 1 2] [--methods NAME ...] [--cycles 5] [--evaluations 500] [--out DIR] [--plot FILE.png]

Each seed has its own demonstrations, starts and evaluation scenes. A cycle plays 100 starts, eight tries each with
exploration noise, learns from them, and is evaluated on 500 unseen scenes without noise. All methods start from the
same policy and play the same number of episodes. `paper` is the method as published: no noise, the best 25 of all
rollouts against the worst 25, no guard. A finished (method, seed) is kept in --out and not run again. Settings were
chosen on the seeds 100 and 101.
"""

from __future__ import annotations

import argparse
import copy
import json
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.common import save
from benchmarks.preference_twin import ChunkMlp, Twin, demonstrate
from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.preferences import (
    CloningConfig,
    LossConfig,
    PreferenceSet,
    Trajectory,
    TuningConfig,
    clone,
    filtered,
    fine_tune,
    reward_weights,
)
from embodiedreamer_gym.wrappers.preference_rollout import PreferenceRolloutVectorWrapper

DEMOS, STARTS, TRIES, NOISE = 12, 100, 8, 0.1
METRIC = "object_distance"
SFT = CloningConfig(epochs=300, batch=128, learning_rate=1e-3)
EPOCHS = 80  # per cycle, as in the paper
CLONING_BATCH, CLONING_RATE = 256, 1e-4  # chunks per step; learning rate of Adam
RATE = 1e-4  # learning rate of the preference losses
PPO_RATE = 3e-4  # default of Stable-Baselines3

Learn = Callable[[ChunkMlp, list[Trajectory], list[Trajectory], int], str]  # network, demos, rollouts, seed -> remark


def prefer(
    variant: str, pairing: str = "same_start", metric: str = METRIC, fall: float | None = 5.0, rate: float = RATE
) -> Learn:
    """Fine-tune on pairs of the rollouts."""

    def learn(network: ChunkMlp, demos: list[Trajectory], rollouts: list[Trajectory], seed: int) -> str:
        pairs = PreferenceSet.choose(rollouts, metric, pairing)
        config = TuningConfig(LossConfig(variant), epochs=EPOCHS, learning_rate=rate, fall=fall, seed=seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the paper's loss, about its missing gradient (see the remark)
            tuned = fine_tune(network, pairs, config)
        stopped = "" if tuned.stopped is None else f", stopped in epoch {tuned.stopped}"
        return (f"{len(pairs)} pairs, {pairs.contrast:.0%} with a success against a failure, gradient {tuned.gradient:.1e}, "
                f"winners {tuned.winner[-1]:+.1f}, losers {tuned.loser[-1]:+.1f} nats{stopped}")  # fmt: skip

    return learn


def imitate(
    choose: Callable[[list[Trajectory], list[Trajectory]], tuple[list[Trajectory], Any]], rate: float = CLONING_RATE
) -> Learn:
    """Clone selected demonstrations and rollouts, optionally with weights."""

    def learn(network: ChunkMlp, demos: list[Trajectory], rollouts: list[Trajectory], seed: int) -> str:
        chosen, weights = choose(demos, rollouts)
        config = CloningConfig(EPOCHS, CLONING_BATCH, rate, seed)
        error = clone(network, chosen, config, weights)[-1]
        return f"{len(chosen)} trajectories, squared error {error:.4f}"

    return learn


METHODS: dict[str, Learn] = {
    "sft": lambda *_: "",
    "sft continued": imitate(lambda demos, _: (demos, None)),
    "filtered bc": imitate(lambda _, rollouts: (filtered(rollouts, METRIC), None)),
    "clipped+dpop": prefer("clipped+dpop"),
    "paper": prefer("paper", "global_rank", "distance", None),
}
MORE: dict[str, Learn] = {
    "filtered bc, top 25": imitate(lambda _, rollouts: (filtered(rollouts, METRIC, "top"), None)),
    "filtered bc, rate 3e-4": imitate(lambda _, rollouts: (filtered(rollouts, METRIC), None), 3e-4),
    "rwr": imitate(lambda _, rollouts: (rollouts, reward_weights(rollouts, METRIC))),
    "paper, noise and pairs": prefer("paper", fall=None),
    "paper, with guard": prefer("paper"),
    "ipo": prefer("ipo"),
    "nll": prefer("nll"),
    "dpop": prefer("dpop"),
    "clipped": prefer("clipped"),
}
PPO = "ppo"


@cache
def _supervised(seed: int) -> tuple[ChunkMlp, list[Trajectory]]:
    demos = demonstrate([50_000_000 + 1000 * seed + i for i in range(DEMOS)])
    torch.manual_seed(seed)
    network = ChunkMlp(demos)
    clone(network, demos, CloningConfig(SFT.epochs, SFT.batch, SFT.learning_rate, seed))
    return network, demos


def first_policy(seed: int) -> tuple[ChunkMlp, list[Trajectory]]:
    """The policy trained on demonstrations by supervised learning, and the demonstrations."""
    network, demos = _supervised(seed)
    return copy.deepcopy(network), demos


def play(network: ChunkMlp, seeds: Sequence[int], tries: int, noise: float) -> list[Trajectory]:
    """Play all rollouts at once."""
    return list(PreferenceRolloutVectorWrapper(Twin(len(seeds) * tries), tries, noise).rollouts(network, seeds))


def judge(network: ChunkMlp, seed: int, count: int) -> dict[str, float]:
    """Share of successes and mean distances (m) on scenes that are never used in training."""
    ends = [one.outcome for one in play(network, [90_000_000 + 1000 * seed + i for i in range(count)], 1, 0.0)]
    return {name: float(np.mean([end[name] for end in ends])) for name in ("is_success", "distance", "object_distance")}


def starts(seed: int, cycle: int, count: int) -> list[int]:
    """Seeds of a cycle's starts."""
    return [10_000_000 + 100_000 * seed + 1000 * cycle + i for i in range(count)]


def study(
    name: str, seed: int, cycles: int, evaluations: int, sft: tuple[ChunkMlp, list[Trajectory]]
) -> dict[str, Any]:
    """Run cycles of one method from the supervised policy; returns a row per evaluation."""
    began, (network, demos) = time.process_time(), sft
    rows = [judge(network, seed, evaluations)]
    for cycle in range(cycles):
        if name == "sft":
            rows.append(rows[0])
            continue
        if name == "paper":  # without noise, every try would be the same
            rollouts = play(network, starts(seed, cycle, STARTS * TRIES), 1, 0.0)
        else:
            rollouts = [] if name == "sft continued" else play(network, starts(seed, cycle, STARTS), TRIES, NOISE)
        try:
            remark = (METHODS | MORE)[name](network, demos, rollouts, seed)
        except PolicyError as error:  # a collapsed policy moves no cup, so there are no pairs to learn from
            remark = str(error)
        rows.append(judge(network, seed, evaluations) | {"remark": remark})
        print(f"{name}, seed {seed}, cycle {cycle + 1}: {rows[-1]['is_success']:.1%}; {remark}", flush=True)
    return {"method": name, "seed": seed, "rows": rows, "cpu_s": time.process_time() - began}


def finished(name: str, seed: int, a: argparse.Namespace) -> dict[str, Any]:
    """Load the result of a (method, seed), or run it if there is none."""
    path = None if a.out is None else a.out / f"{name.replace(' ', '_')}-{seed}.json"
    if path is not None and path.is_file():
        found = json.loads(path.read_text())
        if len(found["rows"]) == a.cycles + 1 and found["evaluations"] == a.evaluations:
            return found
    if name == PPO:
        from benchmarks.preference_ppo import learn  # imports Stable-Baselines3

        found = learn(seed, first_policy(seed)[0], a.cycles, lambda cycle: starts(seed, cycle, STARTS), TRIES, NOISE,
                      METRIC, lambda network: judge(network, seed, a.evaluations), PPO_RATE)  # fmt: skip
    else:
        found = study(name, seed, a.cycles, a.evaluations, first_policy(seed))
    save(found | {"evaluations": a.evaluations}, path)
    return found | {"evaluations": a.evaluations}


def spread(values: Sequence[float]) -> float:
    """Standard error over seeds."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


def table(results: dict[str, list[dict[str, Any]]]) -> str:
    """Success of each method by cycle, and its gain with the standard error over seeds; differences are within seeds."""
    shares = {
        name: np.array([[row["is_success"] for row in one["rows"]] for one in found]) for name, found in results.items()
    }
    cycles = next(iter(shares.values())).shape[1] - 1
    lines = [f"{'success, %':<24}{'start':>7}" + "".join(f"{f'cycle {c + 1}':>9}" for c in range(cycles)) +
             f"{'gain':>15}{'over filtered bc':>19}{'CPU s':>8}"]  # fmt: skip
    for name, share in shares.items():
        gain, cpu = 100 * (share[:, -1] - share[:, 0]), np.mean([one["cpu_s"] for one in results[name]])
        beside = ""
        if "filtered bc" in shares and name != "filtered bc":
            more = 100 * (share[:, -1] - shares["filtered bc"][:, -1])
            beside = f"{more.mean():+.1f} ± {spread(more.tolist()):.1f}"
        lines.append(f"{name:<24}{100 * share[:, 0].mean():>7.1f}" + "".join(f"{100 * x:>9.1f}" for x in share.mean(0)[1:]) +
                     f"{f'{gain.mean():+.1f} ± {spread(gain.tolist()):.1f}':>15}{beside:>19}{cpu:>8.1f}")  # fmt: skip
    return "\n".join(lines)


def draw(results: dict[str, list[dict[str, Any]]], path: Path) -> None:
    """Draw success by cycle: means, and standard errors over seeds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
    for name, found in results.items():
        share = 100 * np.array([[row["is_success"] for row in one["rows"]] for one in found])
        errors = np.array([spread(column.tolist()) for column in share.T])
        axes.errorbar(range(share.shape[1]), share.mean(0), np.nan_to_num(errors), marker=".", capsize=2, label=name)
    axes.set(xlabel="cycle of rollouts and fine-tuning", ylabel="success on unseen scenes [%]", ylim=(0, 100))
    axes.legend(frameon=False, fontsize="small", ncols=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.preferences", description=str(__doc__).splitlines()[0])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=[*METHODS, *MORE, PPO], metavar="NAME",
                        help=f"methods to run, of {', '.join([*METHODS, *MORE, PPO])}")  # fmt: skip
    parser.add_argument("--cycles", type=int, default=5)
    parser.add_argument("--evaluations", type=int, default=500)
    parser.add_argument("--out", type=Path, metavar="DIR", help="output folder; an interrupted run resumes")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    a = parser.parse_args(arguments)
    torch.set_num_threads(1)
    if a.out is not None:
        a.out.mkdir(parents=True, exist_ok=True)
    results = {name: [finished(name, seed, a) for seed in a.seeds] for name in a.methods}
    print(table(results))
    print(f"{time.process_time():.0f} s of CPU in this process")
    if a.plot is not None:
        draw(results, a.plot)


if __name__ == "__main__":
    main()
