"""Shared by all tests: one thread each, no display, and the way to the public recordings."""

from __future__ import annotations

import os
import pickle  # noqa: TID251  a result of this run, from one test process to the others
import sys
from functools import cache
from pathlib import Path

import pytest
from filelock import FileLock

# Before numpy, torch or numba are imported: they read these once.
for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"
os.environ["MPLBACKEND"] = "Agg"

ROOT = Path(__file__).resolve().parents[1]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start the longest tests first: no process waits for one of them at the end."""
    items.sort(key=lambda item: not any(mark.kwargs.get("first") for mark in item.iter_markers("slow")))


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


@cache
def demo_result(folder: Path):
    """The diagnosis of the demo's recordings, made once for all test processes that share a folder."""
    from embodiedreamer_gym import RobotModel, load_recordings
    from embodiedreamer_gym.demo import DATA
    from embodiedreamer_gym.diagnosis import diagnose  # itself, not what stands in for it

    path = folder / "demo.pickle"
    with FileLock(f"{path}.lock"):
        if not path.is_file():
            model = RobotModel.load(DATA / "model.json")
            train, test = (load_recordings(DATA / part) for part in ("train", "test"))
            path.write_bytes(pickle.dumps(diagnose(model, train, test, jobs=os.cpu_count() or 1)))
    return pickle.loads(path.read_bytes())


@pytest.fixture
def shared_demo(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """`diagnose` answers with `demo_result` where it is asked about the demo's model and recordings."""
    import numpy as np

    import embodiedreamer_gym as er
    from embodiedreamer_gym import demo

    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    original, nominal = er.diagnose, er.RobotModel.load(demo.DATA / "model.json")
    logs = [er.load_recordings(demo.DATA / part) for part in ("train", "test")]

    def is_demo(model, *parts) -> bool:
        alike = [
            len(part) == len(log)
            and all(np.array_equal(a.position, b.position) for a, b in zip(part, log, strict=True))
            for part, log in zip(parts, logs, strict=True)
        ]
        return all(alike) and repr(model.parameters()) == repr(nominal.parameters())

    def diagnose(model, train, test, *arguments, **options):
        if not arguments and set(options) <= {"jobs", "progress"} and is_demo(model, train, test):
            return demo_result(folder)
        return original(model, train, test, *arguments, **options)

    monkeypatch.setattr(er, "diagnose", diagnose)
    monkeypatch.setattr(demo, "diagnose", diagnose)
