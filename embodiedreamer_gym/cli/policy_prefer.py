"""The action `policy prefer`: cycles of rolling out, ranking and fine-tuning; one row of a table for each."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from embodiedreamer_gym.io.terminal import check_places, count
from embodiedreamer_gym.pipelines import FRAME_INTERVAL

METHODS = ("preferences", "best_of", "top", "rwr")
ROW_KEYS = ("success", "distance", "object_distance", "remaining", "pairs", "contrast", "gradient", "winners", "losers")


def add_prefer(actions: Any) -> None:
    """Add the action to those of `policy`."""
    text = "improve a policy on its own rollouts: cycles of rolling out, ranking and fine-tuning; goes on where it was"
    one = actions.add_parser("prefer", help=text, description=text)
    one.set_defaults(verb=_prefer)
    one.add_argument("--policy", required=True, metavar="P", help="a folder, or package.module:function")
    one.add_argument("--task", required=True, metavar="ID", help="such as PutCupOnMat-v0")
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="the policy, and what each cycle left")
    one.add_argument("--cycles", type=count, default=5, metavar="N", help="default: %(default)s")
    one.add_argument(
        "--evaluations", type=count, default=100, metavar="N", help="episodes after each cycle (default %(default)s)"
    )
    one.add_argument("--robot", default="aloha", metavar="M", help="JSON file or built-in robot (default %(default)s)")
    one.add_argument(
        "--dream", nargs="?", const="lean", metavar="ALIGNER", help="see through VisAligner (default: lean)"
    )
    one.add_argument("--bank", default="lab", metavar="B", help="references to dream from (default %(default)s)")
    one.add_argument("--every", type=count, default=FRAME_INTERVAL, metavar="N",
                     help="dream after every N-th action and the last of a chunk (default %(default)s)")  # fmt: skip
    one.add_argument("--execute", type=count, metavar="K", help="actions executed of each chunk (default: all)")
    one.add_argument(
        "--envs",
        type=count,
        default=1,
        metavar="E",
        help="episodes at once (default %(default)s); the last digits of what is computed depend on it",
    )
    one.add_argument("--jobs", type=count, default=1, metavar="J", help="processes (default %(default)s)")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.add_argument("--json", type=Path, metavar="FILE", help="write the rows as JSON")
    _rollout_options(one.add_argument_group("rollouts and pairs"))
    _learning_options(one.add_argument_group("learning"))


def _rollout_options(group: Any) -> None:
    group.add_argument("--starts", type=count, default=100, metavar="N", help="of a cycle (default %(default)s)")
    group.add_argument("--tries", type=count, default=4, metavar="K", help="from each start (default %(default)s)")
    group.add_argument(
        "--noise", type=float, default=0.1, metavar="S", help="of exploration, normalised (default %(default)s)"
    )
    group.add_argument("--per", choices=("chunk", "step"), default="chunk", help="noise per (default %(default)s)")
    group.add_argument("--metric", default="remaining", metavar="M", help="remaining (how near it came to the object, then that to"
                       " its goal; the default), object_distance, or distance (end effector to target, the paper's)")  # fmt: skip
    group.add_argument(
        "--pairing", choices=("same_start", "global_rank"), default="same_start", help="default: %(default)s"
    )
    group.add_argument("--top", type=count, metavar="M", help="pairs, or trajectories, at most (the paper's 25)")
    group.add_argument(
        "--margin", type=float, default=0.005, metavar="X", help="near ties are left out, m (default %(default)s)"
    )


def _learning_options(group: Any) -> None:
    group.add_argument("--method", choices=METHODS, default=METHODS[0],
                       help="preferences; or clone the best_of each start, the top of all, or all by reward (rwr)")  # fmt: skip
    group.add_argument(
        "--variant", default="clipped+dpop", metavar="V", help="paper, ipo, nll, dpop, clipped, clipped+dpop"
    )
    group.add_argument("--beta", type=float, default=0.1, metavar="B", help="default: %(default)s")
    group.add_argument(
        "--sigma",
        type=float,
        default=4.0,
        metavar="S",
        help="of the likelihood; the paper's is 1 (default %(default)s)",
    )
    group.add_argument("--epochs", type=count, default=80, metavar="N", help="of a cycle (default %(default)s)")
    group.add_argument("--batch", type=count, metavar="N", help="pairs of a step (25), or chunks to clone (256)")
    group.add_argument("--rate", type=float, metavar="R", help="of Adam (default 3e-5 for preferences, 1e-4 to clone)")
    group.add_argument("--fall", type=float, default=5.0, metavar="NATS",
                       help="the guard stops where winners fall further (default %(default)s; 0: no guard)")  # fmt: skip


def _prefer(a: argparse.Namespace, progress: Any) -> None:
    """Run the cycles that are missing, then print the table."""
    import torch

    from embodiedreamer_gym.io.progress import Progress
    from embodiedreamer_gym.pipelines.preference_study import WEIGHTS, Study, StudySettings
    from embodiedreamer_gym.robot.files import write_json

    torch.set_num_threads(1)
    check_places(a.json)
    check_places(a.out, folders=True)
    settings = StudySettings(**{field.name: getattr(a, field.name) for field in fields(StudySettings)})
    study = Study(settings, a.out, Progress(a.quiet))  # complains before anything is written
    try:
        rows = []
        for cycle in range(a.cycles + 1):
            rows.append(study.row(cycle))
            if hasattr(study.policy, "save"):
                study.policy.save(a.out / "policy")
    finally:
        study.close()
    print(table(rows))
    print(
        f"policy: {a.out / 'policy'}"
        if hasattr(study.policy, "save")
        else f"weights: {study.folder(a.cycles) / WEIGHTS}"
    )
    if a.json is not None:
        write_json({"settings": study.settings, "rows": rows}, a.json)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """One line for each cycle, gain in points with its standard error, scene by scene; cycle 0 is the policy as given."""
    lines = ["cycle" + "".join(f"{key.replace('_', ' '):>17}" for key in ROW_KEYS) + f"{'gain':>17}"]
    for row in rows:
        cells = [f"{row[key]:>17.3g}" if row.get(key) is not None else f"{'':>17}" for key in ROW_KEYS]
        note = f"   stopped in epoch {row['stopped']}" if row.get("stopped") else ""
        lines.append(f"{row['cycle']:>5}" + "".join(cells) + f"{gain(rows[0], row):>17}" + note)
    return "\n".join(lines)


def gain(before: dict[str, Any], after: dict[str, Any]) -> str:
    """What the successes of the same scenes are more, in points, and its standard error."""
    import numpy as np

    more = 100.0 * (np.array(after["successes"], float) - before["successes"])
    error = more.std(ddof=1) / np.sqrt(len(more)) if len(more) > 1 else float("nan")
    return f"{more.mean():+.1f} ± {error:.1f}"
