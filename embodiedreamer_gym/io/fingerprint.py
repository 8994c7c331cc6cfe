"""Whether files that are there already were made with the settings that are wanted now."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import RecordingError


def check_settings(path: Path, there: Mapping[str, Any], wanted: Mapping[str, Any], made: str = "made") -> None:
    """Compare what a file says of itself with what is wanted, both fit for JSON.

    Raises: RecordingError that names the first setting that differs.
    """
    for key, value in wanted.items():
        if there.get(key) != value:
            raise RecordingError(
                f"{path} was {made} with {key} {json.dumps(there.get(key))}, not {json.dumps(value)}; "
                "give another folder, or the same options."
            )
