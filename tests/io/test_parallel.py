"""The same calls through every scheduler: results in order, reported as they come."""

from __future__ import annotations

import pytest
from joblib import Parallel, parallel_config

from embodiedreamer_gym.io import parallel
from embodiedreamer_gym.io.parallel import many

CALLS = [(7, 2), (9, 4), (3, 5)]


def fake_refit(value: int, divisor: int) -> tuple[int, int]:
    return divmod(value, divisor)


@pytest.mark.parametrize("backend", ["sequential", "threading", "loky"])
def test_every_scheduler_gives_the_results_in_order(backend: str) -> None:
    reported: list[tuple[int, tuple[int, int]]] = []
    with parallel_config(backend=backend):
        results = many(fake_refit, CALLS, 2, lambda count, result: reported.append((count, result)))
    assert results == [divmod(*call) for call in CALLS]
    assert reported == list(enumerate(results, 1))


@pytest.mark.parametrize(("jobs", "used"), [(64, 3), (2, 2), (-1, -1)])
def test_no_more_processes_than_calls(jobs: int, used: int, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(parallel, "Parallel", lambda n_jobs, **options: asked.append(n_jobs) or Parallel(1, **options))
    assert many(fake_refit, CALLS, jobs) == [divmod(*call) for call in CALLS] and asked == [used]


def test_a_cluster_gives_the_results_in_order() -> None:
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with distributed.Client(**options), parallel_config(backend="dask"):
        assert many(fake_refit, CALLS, -1) == [divmod(*call) for call in CALLS]


def test_an_error_of_a_call_is_raised_here() -> None:
    with pytest.raises(ZeroDivisionError):
        many(fake_refit, [(1, 0)], 2)
