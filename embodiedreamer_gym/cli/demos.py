"""The verb `demos`: demonstrations of a task by its scripted expert."""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

from embodiedreamer_gym.io.terminal import StatusLine, check_counts

FORMATS = ("aloha", "lerobot")


def add_demos(verbs: Any) -> None:
    """Add the verb."""
    text = "demonstrations of a task by its scripted expert, successes only, for policies to learn from"
    one = verbs.add_parser("demos", help=text, description=text)
    one.add_argument("--task", required=True, metavar="TASK", help="such as PutCupOnMat-v0")
    one.add_argument("--episodes", type=int, default=50, metavar="N", help="that succeed (default %(default)s)")
    one.add_argument(
        "--format", choices=FORMATS, default=FORMATS[0], help="HDF5 files or a LeRobot v3 set (default %(default)s)"
    )
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="goes on where it was")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    one.add_argument("--size", default="128x96", metavar="WxH", help="of the pictures (default %(default)s)")
    one.add_argument("--cameras", default="head", metavar="NAMES", help="with commas (default %(default)s)")
    one.add_argument("--robot", default="aloha", metavar="M", help="JSON file or built-in robot (default %(default)s)")
    one.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="J", help="processes (default: all cores)"
    )
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(verb=_demos)


def _demos(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations, record_lerobot

    check_counts(a, "episodes", "jobs")
    wanted = Demonstrations(task_name(a.task), a.seed, read_size(a.size), tuple(a.cameras.split(",")), a.robot)
    clock = _Clock(a.episodes, a.quiet)
    record = record_demonstrations if a.format == FORMATS[0] else record_lerobot
    failed = record(wanted, a.episodes, a.out, a.jobs, clock)
    print(f"{a.episodes} episodes in {a.out}; {failed} attempts failed and were left out")


class _Clock:
    """Says on stderr how far it is and how long it takes."""

    def __init__(self, episodes: int, quiet: bool) -> None:
        self._count, self._line = episodes, StatusLine(quiet)
        self._begun, self._first = time.monotonic(), -1

    def __call__(self, done: int, failed: int) -> None:
        self._first = done - 1 if self._first < 0 else self._first  # those before were there already
        each = (time.monotonic() - self._begun) / max(done - self._first, 1)
        left = each * (self._count - done) / 60.0
        self._line.say(
            f"{done} of {self._count} episodes, {failed} failed, {each:.1f} s each, {left:.0f} min left",
            last=done == self._count,
        )
