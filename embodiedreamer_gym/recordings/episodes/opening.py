"""Open a set of episodes, whichever format it has."""

from __future__ import annotations

import os
from pathlib import Path

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.episodes.aloha import AlohaEpisodes
from embodiedreamer_gym.recordings.episodes.episode_set import EpisodeSet
from embodiedreamer_gym.recordings.files import natural

HDF5 = (".hdf5", ".h5")


def open_episodes(path: str | os.PathLike[str], rate: float | None = None) -> EpisodeSet:
    """Episodes of an ALOHA or AgileX HDF5 file, of a folder of them in natural order, or of a LeRobot v3 folder.

    rate: Hz, of HDF5 files that do not say it.
    Raises: RecordingError where there is no episode, or the set cannot be used; MissingExtraError for a LeRobot set where
    pyarrow or av are absent.
    """
    path = Path(path).expanduser()
    if (path / "meta").is_dir():
        from embodiedreamer_gym.recordings.episodes.lerobot import LeRobotEpisodes

        return LeRobotEpisodes(path)
    if path.is_file():
        if path.suffix not in HDF5:
            raise RecordingError(f"{path}: the suffix {path.suffix!r} is not known; episodes are .hdf5 or .h5 files")
        return AlohaEpisodes([path], rate)
    if not path.is_dir():
        raise RecordingError(f"{path}: there is no such file or folder")
    found = [one for one in path.iterdir() if one.suffix in HDF5 and not one.name.startswith(".")]
    if not found:
        raise RecordingError(f"{path}: there is no episode; expected .hdf5 files, or meta/info.json of a LeRobot set")
    return AlohaEpisodes(sorted(found, key=natural), rate)
