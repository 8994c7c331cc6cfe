"""Choice of episodes of a set: `0,3-7`, after a colon behind the set's path or as an option."""

from __future__ import annotations

import os
import re

from embodiedreamer_gym.errors import RecordingError, brief

SUFFIX = re.compile(r"(.+):(\d[\d,\s-]*)", re.DOTALL)
MOST_DIGITS = 9


def parse_episodes(text: str) -> tuple[int, ...]:
    """Numbers of a text such as "0,3-7", in its order, none twice.

    Raises: RecordingError for another text, or a range that runs backwards.
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
    """The path of `PATH:0,3-7` and its episodes; None for a path without such an end, or one that exists as it is."""
    match = SUFFIX.fullmatch(pattern)
    if match is None or os.path.lexists(pattern):
        return pattern, None
    return match[1], parse_episodes(match[2])
