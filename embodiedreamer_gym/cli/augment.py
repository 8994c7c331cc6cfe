"""The verb `augment`: recorded episodes with other pictures, dreamed from edited references."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.terminal import check_counts

EDITS = "recolour[:NAME,...], background[:FOLDER], table[:FOLDER], paper, inpaint:FOLDER"


def add_augment(verbs: Any) -> None:
    """Add the verb."""
    text = "replay recorded episodes and film them anew through the video model, from edited first frames"
    one = verbs.add_parser("augment", help=text, description=text)
    one.add_argument("--data", nargs="+", required=True, metavar="DIR", help="HDF5 episodes, as `demos` writes them")
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="goes on where it was")
    one.add_argument("--edit", nargs="+", default=[], metavar="EDIT", help=f"{EDITS} (default: none, dream only)")
    one.add_argument("--prompt", metavar="TEXT", help="what inpaint is to paint")
    one.add_argument("--copies", type=int, default=1, metavar="N", help="of each episode (default %(default)s)")
    one.add_argument("--aligner", default="lean", metavar="A", help="lean, a file or folder (default %(default)s)")
    one.add_argument(
        "--bank", default="lab", metavar="B",
        help="photos for the first frame: lab, a file, or none for the episode's own (default %(default)s)",
    )  # fmt: skip
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    one.add_argument("--task", metavar="TASK", help="of files that do not say it, such as PutCupOnMat-v0")
    one.add_argument("--robot", metavar="M", help="that replays: JSON file or built-in (default: the recorded one)")
    one.add_argument("--jobs", type=int, default=1, metavar="J", help="processes (default %(default)s)")
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(verb=_augment)


def _augment(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.pipelines.regenerate import regenerate

    check_counts(a, "copies", "jobs")
    check_counts(a, "seed", least=0)
    task = None if a.task is None else task_name(a.task)
    if a.prompt is not None and not any(edit.startswith("inpaint") for edit in a.edit):
        raise EmbodieDreamerError("--prompt is for --edit inpaint:FOLDER; leave it out.")

    found = regenerate(
        a.data, a.out, a.aligner, None if a.bank == "none" else a.bank, _editor(a.edit), a.copies, a.seed, None if a.quiet else progress,
        prompt=a.prompt, task=task, robot=a.robot, jobs=a.jobs,
    )  # fmt: skip
    print(f"{found.written + found.kept} episodes in {a.out}, {found.kept} of them were there")
    if found.failed:
        print(f"{len(found.failed)} recorded episodes no longer end in success and were left out: "
              f"{', '.join(found.failed[:10])}{', ...' if len(found.failed) > 10 else ''}")  # fmt: skip


def _editor(edits: list[str]) -> Any:
    """The edits of a command line as one editor; None without any."""
    from embodiedreamer_gym.vis_aligner.editing import Chain

    made = [_one(*edit.partition(":")[::2]) for edit in edits]
    return None if not made else made[0] if len(made) == 1 else Chain(made)


def _one(kind: str, value: str) -> Any:
    """One edit: what is before its colon, and what behind."""
    from embodiedreamer_gym.envs.cameras import CAMERAS
    from embodiedreamer_gym.vis_aligner.editing import Background, Inpaint, PaperSheet, Recolour

    if kind == "recolour":
        return Recolour(tuple(value.split(",")) if value else None)
    if kind == "background":
        return Background(pictures=value or None)
    if kind == "table":
        return Background(("table",), value or None)
    if kind == "paper" and not value:
        return PaperSheet(CAMERAS["head"])
    if kind == "inpaint" and value:
        return Inpaint(value)
    raise EmbodieDreamerError(f"--edit {kind}{':' if value else ''}{value} is none of {EDITS}.")
