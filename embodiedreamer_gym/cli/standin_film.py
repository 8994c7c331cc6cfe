"""The verb `standin film`: episodes of the tasks, rendered by Blender's path tracer."""

from __future__ import annotations

import argparse
import os
import warnings
from pathlib import Path
from typing import Any

from embodiedreamer_gym.io.terminal import check_counts


def add_film(actions: Any) -> None:
    """Add the action to those of `embodiedreamer standin`."""
    text = "episodes of the tasks rendered by a path tracer (Blender's Cycles), with the simulator's frames beside them"
    one = actions.add_parser("film", help=text, description=text)
    one.add_argument("--task", nargs="+", default=["all"], metavar="TASK", help="names, or all (default %(default)s)")
    one.add_argument("--episodes", type=int, default=1, metavar="N", help="of each task (default %(default)s)")
    text = "lab: one appearance; many: another one per episode; or a number that draws one (default %(default)s)"
    one.add_argument("--appearance", default="lab", metavar="A", help=text)
    one.add_argument("--look", dest="appearance", action=_Renamed, default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    one.add_argument("--size", default="128x96", metavar="WxH", help="of the pictures (default %(default)s)")
    one.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="TASK_000.hdf5, ...; existing ones are kept"
    )
    one.add_argument("--seed", type=int, default=0, help="of all random choices (default 0)")
    text = "largest number of pictures, from a random start (default: the whole episode)"
    one.add_argument("--frames", type=int, metavar="F", help=text)
    one.add_argument(
        "--every", type=int, default=1, metavar="K", help="control steps per picture (default %(default)s)"
    )
    one.add_argument("--samples", type=int, default=4, metavar="N", help="light paths per pixel (default %(default)s)")
    text = "Python interpreter that has bpy (default: this one if it has, else $EMBODIEDREAMER_BLENDER)"
    one.add_argument("--blender", metavar="PYTHON", help=text)
    one.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="J", help="processes (default: all cores)"
    )
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(verb=_film)


class _Renamed(argparse.Action):
    """An option's former name: stores its value and warns."""

    def __call__(
        self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: str | None = None
    ) -> None:
        """Store the value under the option's present name."""
        warnings.warn(f"{option_string} is deprecated; use --{self.dest}.", DeprecationWarning, stacklevel=2)
        setattr(namespace, self.dest, values)


def _film(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs.tasks import TASKS  # PyBullet prints a line when it is loaded
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.standin.film.run import film_episodes
    from embodiedreamer_gym.standin.film.settings import FilmSettings

    check_counts(a, "episodes", "jobs")
    size = read_size(a.size)
    tasks = list(TASKS) if a.task == ["all"] else [name.removesuffix("-v0") for name in a.task]
    films = [
        FilmSettings(task, a.appearance, size, a.seed, a.frames, a.every, a.samples) for task in dict.fromkeys(tasks)
    ]
    paths = film_episodes(films, a.episodes, a.out, a.jobs, a.blender, a.quiet)
    print(f"{len(paths)} episodes in {a.out}")
