"""Entries that come with the package: each file defines `answer`, which returns a `Finding` for a `Task`."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from embodiedreamer_gym.bench.entries.finding import Finding
from embodiedreamer_gym.bench.task import Task
from embodiedreamer_gym.errors import EmbodieDreamerError

ENTRIES = {  # name -> file
    "diagnose": "diagnosis_entry",
    "coulomb": "coulomb",
    "ladder": "ladder",
    "mujoco-sysid": "mujoco_sysid",
    "sparse": "sparse",
    "boosted": "boosted",
}


def load_entry(name: str) -> Callable[[Task], Finding]:
    """The function of an entry.

    Raises: EmbodieDreamerError for an unknown name, MissingExtraError if it needs a package that is not installed.
    """
    if name not in ENTRIES:
        raise EmbodieDreamerError(f"there is no entry '{name}'; give one of {', '.join(ENTRIES)}.")
    return importlib.import_module(f"embodiedreamer_gym.bench.entries.{ENTRIES[name]}").answer
