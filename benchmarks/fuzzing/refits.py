"""Write and read the refit cache of a diagnosis without a diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

FITS = ("0 effects + coulomb_friction", "0 effects + backlash", "1 effects + torque_bias")


def _open(path: Path, model: Path, log: Path) -> Any:
    from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
    from embodiedreamer_gym.effects import CATALOGUE
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.robot import RobotModel

    return RefitCache(path, RobotModel.load(model), list(load_recordings(log)), CATALOGUE)


def write_refits(path: Path, model: Path, log: Path) -> None:
    """Write some fits to the cache."""
    cache = _open(path, model, log)
    for number, name in enumerate(FITS):
        cache.keep(name, np.linspace(0.1, 0.9, 8 + 2 * number), "linear")


def read_refits(path: Path, model: Path, log: Path) -> None:
    """Read the fits, and add one more."""
    cache = _open(path, model, log)
    for name in FITS:
        cache.get(name)
    cache.keep("2 effects + backlash", np.zeros(3), None)
