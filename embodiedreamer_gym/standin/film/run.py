"""Film many episodes in parallel, skipping those that exist, with a progress line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.parallel import each
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.io.shard import Shard
from embodiedreamer_gym.standin.film.blender import find_blender
from embodiedreamer_gym.standin.film.episode import Render, film_episode
from embodiedreamer_gym.standin.film.settings import FilmSettings
from embodiedreamer_gym.standin.film.write import is_filmed

TYPICAL = 200  # pictures of a whole episode


def film_episodes(films: Sequence[FilmSettings], episodes: int, folder: str | Path, jobs: int = 1, blender: str | None = None,
                  progress: ProgressCallback | None = None, render: Render | None = None, shard: Shard | None = None) -> list[Path]:  # fmt: skip
    """Film a number of episodes of each film into a folder; returns their paths, also of existing ones.

    jobs: processes.
    blender: path of a Python interpreter that has bpy, see `find_blender`.
    progress: called with the number of pictures rendered so far.
    render: used instead of Blender.
    shard: the part of all episodes to film; None: all.
    Raises: MissingExtraError without bpy; RecordingError, before filming, where a path has other content.
    """
    folder = Path(folder)
    if render is None:
        find_blender(blender)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"the folder {folder} cannot be created: {error.strerror}; give another one.") from error
    wanted = (shard or Shard()).of([(film, number) for film in films for number in range(episodes)])
    missing = [(film, n) for film, n in wanted if not is_filmed(film.path(folder, n), film.as_dict(n))]
    total = sum(len(film.cameras) * min(film.frames or TYPICAL, TYPICAL // film.every) for film, _ in missing)
    report, pictures, finished = progress_or_silence(progress), 0, 0

    def show(more: int = 1) -> None:
        nonlocal pictures
        pictures += more
        report("pictures", pictures, max(total, pictures), episodes=f"{finished} of {len(missing)}")

    if missing:
        show(0)
    for more in _film(missing, folder, jobs, blender, show, render):
        finished += 1
        show(more)
    return [film.path(folder, number) for film, number in wanted]


def _film(missing: Sequence[tuple[FilmSettings, int]], folder: Path, jobs: int, blender: str | None,
          picture: Callable[[], None], render: Render | None) -> Iterator[int]:  # fmt: skip
    """For each finished episode, the number of its pictures that were not reported during filming."""
    if jobs == 1:
        for film, number in missing:
            film_episode(film, number, folder, blender, picture, render)
            yield 0
    else:
        calls = [(film, number, folder, blender, None, render) for film, number in missing]
        yield from each(film_episode, calls, jobs, in_order=False)
