"""Imports PyBullet without its banner, with a clear error if it is missing and a warning if it is installed twice."""

from __future__ import annotations

import os
import warnings
from importlib import metadata

from embodiedreamer_gym.errors import MissingExtraError
from embodiedreamer_gym.io.quiet import silenced

BUILDS = ("pybullet", "pybullet-arm64")  # two distributions of the same module

try:
    with silenced():  # it prints its build time
        import pybullet
        from pybullet_utils.bullet_client import BulletClient
except ImportError as error:
    raise MissingExtraError(
        "PyBullet is not installed for this Python; use engine='mujoco', or a Python for which "
        "'pip install pybullet' or 'pip install pybullet-arm64' finds a wheel (3.11 to 3.13)."
    ) from error

__all__ = ["BUILDS", "BulletClient", "World", "pybullet"]


def installed_builds() -> list[str]:
    """Names of the PyBullet distributions that are installed."""
    return [name for name in BUILDS if any(metadata.distributions(name=name))]


def warn_of_two_builds() -> None:
    """Warn where both distributions are installed: they overwrite each other's files."""
    if len(installed_builds()) > 1:
        warnings.warn(
            "pybullet and pybullet-arm64 are both installed and overwrite each other's files; "
            "run: pip uninstall pybullet pybullet-arm64, then install one of them.",
            RuntimeWarning, stacklevel=2,
        )  # fmt: skip


warn_of_two_builds()


class World(BulletClient):
    """A separate PyBullet world in this process, without a window; a plain BulletClient prints when it connects."""

    def __init__(self) -> None:
        self._shapes: dict = {}
        self._pid = os.getpid()
        self._client = pybullet.connect(pybullet.DIRECT)
