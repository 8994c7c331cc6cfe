"""pyarrow and av, which LeRobot's format needs and an extra brings."""

from __future__ import annotations

import importlib
from typing import Any

from embodiedreamer_gym.errors import MissingExtraError


def load_extra(name: str) -> Any:
    """Import a module of pyarrow or av.

    Raises: MissingExtraError with the line that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(
            f"LeRobot sets need {name.partition('.')[0]}, which is not installed; "
            "run: pip install 'embodiedreamer-gym[data]'"
        ) from error
