"""Selection of episodes of a set, such as `0,3-7`: after the set's path and a colon, or as an option."""

from __future__ import annotations

import os
import re

from embodiedreamer_gym.errors import RecordingError, brief

SUFFIX = re.compile(r"(.+):(\d[\d,\s-]*)", re.DOTALL)
MOST_DIGITS = 9


def parse_episodes(text: str) -> tuple[int, ...]:
    """Episode numbers from text such as "0,3-7", in the order given, without duplicates.

    Raises: RecordingError for any other text, or a range that runs backwards or is too long.
    """
    numbers: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part, re.ASCII)
        first, last = (match[1], match[2] or match[1]) if match else ("", "")
        if not match or max(len(first), len(last)) > MOST_DIGITS or int(last) < int(first):
            raise RecordingError(f"episodes {brief(text)} are not numbers and ranges such as 0,3-7")
        if int(last) - int(first) > 100_000:
            raise RecordingError(f"episodes {brief(text)} are more than 100000; give fewer")
        numbers |= dict.fromkeys(range(int(first), int(last) + 1))
    return tuple(numbers)


def split_episodes(pattern: str) -> tuple[str, tuple[int, ...] | None]:
    """Path and episodes of `PATH:0,3-7`; episodes are None if there is no such suffix or the whole text is a path."""
    match = SUFFIX.fullmatch(pattern)
    if match is None or os.path.lexists(pattern):
        return pattern, None
    return match[1], parse_episodes(match[2])
