"""The verb `standin film`: episodes of the tasks before the stand-in's path-traced camera."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from embodiedreamer_gym.io.terminal import check_counts


def add_film(actions: Any) -> None:
    """Add the action to those of `embodiedreamer standin`."""
    text = "episodes of the tasks before a path-traced camera (Blender's Cycles), beside the simulator's frames"
    one = actions.add_parser("film", help=text, description=text)
    one.add_argument("--task", nargs="+", default=["all"], metavar="TASK", help="names, or all (default %(default)s)")
    one.add_argument("--episodes", type=int, default=1, metavar="N", help="of each task (default %(default)s)")
    one.add_argument("--look", default="lab", metavar="LOOK",
                     help="lab: one bench; many: another one per episode; or a number (default %(default)s)")  # fmt: skip
    one.add_argument("--size", default="128x96", metavar="WxH", help="of the pictures (default %(default)s)")
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="TASK_000.hdf5, ...; goes on where it was")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    one.add_argument(
        "--frames", type=int, metavar="F", help="at most, a stretch at random (default: the whole episode)"
    )
    one.add_argument("--every", type=int, default=1, metavar="K", help="control steps (default: every one)")
    one.add_argument("--samples", type=int, default=4, metavar="N", help="paths per pixel (default %(default)s)")
    one.add_argument("--blender", metavar="PYTHON", help="a Python that has bpy (default: this one)")
    one.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="J", help="processes (default: all cores)"
    )
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(verb=_film)


def _film(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs.tasks import TASKS  # PyBullet prints a line when it is loaded
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.standin.film.run import film_episodes
    from embodiedreamer_gym.standin.film.settings import Film

    check_counts(a, "episodes", "jobs")
    size = read_size(a.size)
    tasks = list(TASKS) if a.task == ["all"] else [name.removesuffix("-v0") for name in a.task]
    films = [Film(task, a.look, size, a.seed, a.frames, a.every, a.samples) for task in dict.fromkeys(tasks)]
    paths = film_episodes(films, a.episodes, a.out, a.jobs, a.blender, a.quiet)
    print(f"{len(paths)} episodes in {a.out}")
