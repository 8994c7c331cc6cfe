"""Optional dependencies: pyarrow and av for LeRobot sets, rosbags for ROS bags; extras install them."""

from __future__ import annotations

import importlib
from typing import Any

from embodiedreamer_gym.errors import MissingExtraError


def load_extra(name: str) -> Any:
    """Import a module of pyarrow, av or rosbags.

    Raises: MissingExtraError with the command that installs it.
    """
    what, extra = ("MCAP and rosbag2 files", "ros") if name.startswith("rosbags") else ("LeRobot sets", "data")
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(
            f"{what} need {name.partition('.')[0]}, which is not installed; run: pip install 'embodiedreamer-gym[{extra}]'"
        ) from error
