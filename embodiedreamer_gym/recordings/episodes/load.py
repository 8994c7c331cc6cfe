"""Open a set of episodes, whichever format it has."""

from __future__ import annotations

import os
from pathlib import Path

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.recordings.episodes.aloha import AlohaEpisodes
from embodiedreamer_gym.recordings.episodes.episode_set import EpisodeSet
from embodiedreamer_gym.recordings.files import natural
from embodiedreamer_gym.recordings.hdf5 import SUFFIXES


@renamed_arguments(rate="hz")
def open_episodes(path: str | os.PathLike[str], hz: float | None = None) -> EpisodeSet:
    """Episodes of an ALOHA or AgileX HDF5 file, of a folder of them in natural order, or of a LeRobot v3 folder.

    hz: control rate, Hz, of HDF5 files that do not state it.
    Raises: RecordingError where there is no episode, or the set cannot be used; MissingExtraError for a LeRobot set where
    pyarrow or av are absent.
    """
    path = Path(path).expanduser()
    if (path / "meta").is_dir():
        from embodiedreamer_gym.recordings.episodes.lerobot import LeRobotEpisodes

        return LeRobotEpisodes(path)
    if path.is_file():
        if path.suffix not in SUFFIXES:
            raise RecordingError(f"{path}: the suffix {path.suffix!r} is not known; episodes are .hdf5 or .h5 files")
        return AlohaEpisodes([path], hz)
    if not path.is_dir():
        raise RecordingError(f"{path}: there is no such file or folder")
    files = [one for one in path.iterdir() if one.suffix in SUFFIXES and not one.name.startswith(".")]
    if not files:
        raise RecordingError(f"{path}: there is no episode; expected .hdf5 files, or meta/info.json of a LeRobot set")
    return AlohaEpisodes(sorted(files, key=natural), hz)
