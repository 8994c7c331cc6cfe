"""What the benchmarks share: where real data lie, one thread for BLAS, intervals of shares, results written beside and renamed."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from embodiedreamer_gym.recordings import Recordings

SHARED = Path(os.environ.get("EMBODIEDREAMER_SHARED_DATA", Path(__file__).parents[2] / "shared" / "data"))


def data_folder(name: str) -> Path:
    """Folder of a real data set, which is not shipped."""
    return SHARED / name


def folder(text: str) -> Path:
    """A folder given on the command line, or by default. Raises: ArgumentTypeError where it is missing."""
    if not Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"{text} is no folder; the real recordings are not shipped, give theirs.")
    return Path(text)


def times(text: str) -> int:
    """How often, at least once. Raises: ArgumentTypeError for anything else."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not allowed; give a whole number of at least 1.")
    return int(text)


def pin_threads() -> None:
    """One thread for BLAS and Numba; takes effect for libraries that are not loaded yet."""
    for key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(key, "1")


def save(rows: Any, path: Path | None) -> None:
    """Write results as JSON, if a path is given."""
    if path is not None:
        part = path.with_name(path.name + ".part")
        part.write_text(json.dumps(rows, indent=1))
        part.replace(path)


def clopper_pearson(hits: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share."""
    from embodiedreamer_gym.bench.intervals import clopper_pearson as interval

    return interval(hits, trials)


def redrawn(recordings: Recordings, seed: int) -> tuple[Recordings, Recordings]:
    """Train and held-out part, dealt in turn within each kind after shuffling."""
    import numpy as np

    order = np.random.default_rng(seed).permutation(len(recordings))
    return type(recordings)(recordings[int(i)] for i in order).split()
