"""Film many episodes in parallel, skipping those that exist, with a progress line."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.terminal import StatusLine
from embodiedreamer_gym.standin.film.blender import find_blender
from embodiedreamer_gym.standin.film.episode import Render, film_episode
from embodiedreamer_gym.standin.film.settings import FilmSettings
from embodiedreamer_gym.standin.film.write import is_filmed

TYPICAL = 200  # pictures of a whole episode
ENOUGH = 5  # pictures after which the remaining time is estimated


class FilmProgress:
    """Progress and remaining time on stderr."""

    def __init__(self, films: Sequence[FilmSettings], quiet: bool = False) -> None:
        self._line, self._begun = StatusLine(quiet), time.monotonic()
        self._whole = sum(min(film.frames or TYPICAL, TYPICAL // film.every) for film in films)
        self._count, self._pictures, self._done = len(films), 0, 0

    def picture(self, more: int = 1) -> None:
        """Count rendered pictures."""
        self._pictures += more
        if self._pictures >= ENOUGH:
            self._show()

    def episode(self) -> None:
        """Count a written episode."""
        self._done += 1
        if self._done == self._count:
            self._show(last=True)

    def _show(self, last: bool = False) -> None:
        each = (time.monotonic() - self._begun) / max(self._pictures, 1)
        left = 0.0 if last else each * max(self._whole - self._pictures, 0)
        self._line.say(
            f"{self._done} of {self._count} episodes, {self._pictures} pictures, {each:.2f} s each, {left / 60.0:.0f} min left",
            last=last,
        )


def film_episodes(films: Sequence[FilmSettings], episodes: int, folder: str | Path, jobs: int = 1, blender: str | None = None,
                  quiet: bool = True, render: Render | None = None) -> list[Path]:  # fmt: skip
    """Film so many episodes of each of the films into a folder; returns the paths of all, also of existing ones.

    jobs: processes.
    blender: path of a Python interpreter that has bpy, see `find_blender`.
    quiet: no progress.
    render: used in place of Blender.
    Raises: MissingExtraError without bpy; RecordingError where a path holds something else, before anything is filmed.
    """
    folder = Path(folder)
    if render is None:
        find_blender(blender)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder} cannot be made a folder: {error.strerror}; give another place.") from error
    wanted = [(film, number) for film in films for number in range(episodes)]
    missing = [(film, n) for film, n in wanted if not is_filmed(film.path(folder, n), film.as_dict(n))]
    progress = FilmProgress([film for film, _ in missing], quiet)
    for pictures in _film(missing, folder, jobs, blender, progress, render):
        progress.picture(pictures)
        progress.episode()
    return [film.path(folder, number) for film, number in wanted]


def _film(missing: Sequence[tuple[FilmSettings, int]], folder: Path, jobs: int, blender: str | None,
          progress: FilmProgress, render: Render | None) -> Iterator[int]:  # fmt: skip
    """For each finished episode, its number of pictures that were not reported while it was filmed."""
    if jobs == 1:
        for film, number in missing:
            film_episode(film, number, folder, blender, progress.picture, render)
            yield 0
    else:
        work: Any = Parallel(n_jobs=jobs, prefer="processes", return_as="generator_unordered")
        yield from work(delayed(film_episode)(film, n, folder, blender, None, render) for film, n in missing)
