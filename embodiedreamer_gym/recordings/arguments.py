"""Recordings as arguments of the package's functions: one, or several."""

from __future__ import annotations

from collections.abc import Iterable

from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings.recording import Recording


def as_recordings(given: Recording | Iterable[Recording]) -> tuple[Recording, ...]:
    """One or several recordings as a tuple.

    Raises: RecordingError for anything else, such as the path of a log.
    """
    if isinstance(given, Recording):
        return (given,)
    found = tuple(given) if isinstance(given, Iterable) else (given,)
    for one in found:
        if not isinstance(one, Recording):
            raise RecordingError(f"{str(given)[:60]!r} is not a recording; read logs with load_recordings.")
    return found
