"""Shared by all tests: one thread each, no display, and the way to the public recordings."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

# Before numpy, torch or numba are imported: they read these once.
for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"
os.environ["MPLBACKEND"] = "Agg"

ROOT = Path(__file__).resolve().parents[1]


def pytest_runtest_setup() -> None:
    """Pin torch too, without importing it for the tests that do not use it."""
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "set_num_threads"):
        torch.set_num_threads(1)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the public recordings, which are not part of this repository."""
    given = os.environ.get("EMBODIEDREAMER_SHARED_DATA")
    folder = Path(given) if given else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no recordings in {folder}: set EMBODIEDREAMER_SHARED_DATA to the folder that holds them")
    return folder
