"""Many episodes: in processes, with what is there already left alone, and a line that says how long it takes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.terminal import StatusLine
from embodiedreamer_gym.standin.film.blender import check_blender
from embodiedreamer_gym.standin.film.episode import Render, film_episode
from embodiedreamer_gym.standin.film.settings import Film
from embodiedreamer_gym.standin.film.write import is_filmed

TYPICAL = 200  # pictures of a whole episode
ENOUGH = 5  # pictures by which the time left is judged


class Clock:
    """Says on stderr how far the filming is."""

    def __init__(self, films: Sequence[Film], quiet: bool = False) -> None:
        self._line, self._begun = StatusLine(quiet), time.monotonic()
        self._whole = sum(min(film.frames or TYPICAL, TYPICAL // film.every) for film in films)
        self._count, self._pictures, self._done = len(films), 0, 0

    def picture(self, more: int = 1) -> None:
        """Pictures have been made."""
        self._pictures += more
        if self._pictures >= ENOUGH:
            self._say()

    def episode(self) -> None:
        """An episode has been written."""
        self._done += 1
        if self._done == self._count:
            self._say(last=True)

    def _say(self, last: bool = False) -> None:
        each = (time.monotonic() - self._begun) / max(self._pictures, 1)
        left = 0.0 if last else each * max(self._whole - self._pictures, 0)
        self._line.say(
            f"{self._done} of {self._count} episodes, {self._pictures} pictures, {each:.2f} s each, {left / 60.0:.0f} min left",
            last=last,
        )


def film_episodes(films: Sequence[Film], episodes: int, folder: str | Path, jobs: int = 1, python: str | None = None,
                  quiet: bool = True, render: Render | None = None) -> list[Path]:  # fmt: skip
    """Film episodes of each film into a folder, one file each; paths of all, those that were there already too.

    jobs: processes; python: one that has bpy, by default this one; render: in place of Blender.
    Raises: MissingExtraError without bpy; RecordingError for a file in the way, before anything is filmed.
    """
    folder = Path(folder)
    if render is None:
        check_blender(python)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder} cannot be made a folder: {error.strerror}; give another place.") from error
    wanted = [(film, number) for film in films for number in range(episodes)]
    missing = [(film, n) for film, n in wanted if not is_filmed(film.path(folder, n), film.settings(n))]
    clock = Clock([film for film, _ in missing], quiet)
    for pictures in _film(missing, folder, jobs, python, clock, render):
        clock.picture(pictures)
        clock.episode()
    return [film.path(folder, number) for film, number in wanted]


def _film(missing: Sequence[tuple[Film, int]], folder: Path, jobs: int, python: str | None, clock: Clock,
          render: Render | None) -> Iterator[int]:  # fmt: skip
    """Numbers of pictures not counted yet, as episodes are finished."""
    if jobs == 1:
        for film, number in missing:
            film_episode(film, number, folder, python, clock.picture, render)
            yield 0
    else:
        work: Any = Parallel(n_jobs=jobs, prefer="processes", return_as="generator_unordered")
        yield from work(delayed(film_episode)(film, n, folder, python, None, render) for film, n in missing)
