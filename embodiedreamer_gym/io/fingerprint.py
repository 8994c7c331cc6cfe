"""Check that existing files were made with the current settings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import RecordingError


def check_settings(path: Path, there: Mapping[str, Any], wanted: Mapping[str, Any], made: str = "made") -> None:
    """Compare the settings stored in a file (`there`) with those wanted; both are JSON-serialisable.

    Raises: RecordingError that names the first setting that differs.
    """
    for key, value in wanted.items():
        if there.get(key) != value:
            raise RecordingError(
                f"{path} was {made} with {key} {json.dumps(there.get(key))}, not {json.dumps(value)}; "
                "give another folder, or the same options."
            )
