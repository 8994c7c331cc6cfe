"""Close the gap between a real robot arm and its simulation; public names are imported on first use.

Importing the package registers its environments with Gymnasium.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from embodiedreamer_gym.envs import register_envs

if TYPE_CHECKING:
    from embodiedreamer_gym.diagnosis import (
        Comparison,
        Diagnosis,
        ErrorBreakdown,
        add_effect,
        compare,
        diagnose,
        error_breakdown,
        where,
    )
    from embodiedreamer_gym.diagnosis.report import write_report
    from embodiedreamer_gym.effects import CATALOGUE
    from embodiedreamer_gym.errors import EmbodieDreamerError
    from embodiedreamer_gym.phys_aligner import Calibration, calibrate
    from embodiedreamer_gym.recordings import (
        Recording,
        Recordings,
        load_recordings,
        preflight,
        save_recording,
    )
    from embodiedreamer_gym.robot import RobotModel, built_in_robots
    from embodiedreamer_gym.simulation import simulate

__version__ = "0.1.0"

__all__ = [
    "CATALOGUE",
    "Calibration",
    "Comparison",
    "Diagnosis",
    "EmbodieDreamerError",
    "ErrorBreakdown",
    "Recording",
    "Recordings",
    "RobotModel",
    "__version__",
    "add_effect",
    "built_in_robots",
    "calibrate",
    "compare",
    "diagnose",
    "error_breakdown",
    "load_recordings",
    "preflight",
    "save_recording",
    "simulate",
    "where",
    "write_report",
]

_HOMES = {
    "diagnosis": (
        "Comparison",
        "Diagnosis",
        "ErrorBreakdown",
        "add_effect",
        "compare",
        "diagnose",
        "error_breakdown",
        "where",
    ),
    "diagnosis.report": ("write_report",),
    "effects": ("CATALOGUE",),
    "errors": ("EmbodieDreamerError",),
    "phys_aligner": ("Calibration", "calibrate"),
    "recordings": ("Recording", "Recordings", "load_recordings", "preflight", "save_recording"),
    "robot": ("RobotModel", "built_in_robots"),
    "simulation": ("simulate",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a public name from the package that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


register_envs()


def __dir__() -> list[str]:
    return sorted(__all__)
