"""Parallel calls of a function, through joblib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from joblib import Parallel, delayed
from joblib.externals.loky import reusable_executor

T = TypeVar("T")


@contextmanager
def ended_workers() -> Iterator[None]:
    """End the worker processes that `many` starts in this block, however the block ends.

    Otherwise joblib keeps them for the next call, and after an interruption they would continue their work.
    """
    before = reusable_executor._executor
    try:
        yield
    finally:
        started = reusable_executor._executor
        if started is not None and started is not before:
            started.terminate(kill_workers=True)  # also removes its folder of temporary files


def each(
    function: Callable[..., T], calls: Sequence[tuple[Any, ...]], jobs: int = 1, in_order: bool = True
) -> Iterator[T]:
    """Results of a function for many tuples of arguments, in their order, or each as soon as it is finished.

    jobs: processes on this machine, at most one per call, unless `joblib.parallel_config` selects another backend:
    threads, or Dask or Ray on a cluster. The results are the same for every backend.
    """
    work: Any = Parallel(n_jobs=min(jobs, max(len(calls), 1)), prefer="processes",
                         return_as="generator" if in_order else "generator_unordered")  # fmt: skip
    yield from work(delayed(function)(*c) for c in calls)


def many(
    function: Callable[..., T], calls: Sequence[tuple[Any, ...]], jobs: int = 1,
    done: Callable[[int, T], None] | None = None,
) -> list[T]:  # fmt: skip
    """Results of a function for many tuples of arguments, in their order; see `each`.

    done: is called after each result, with the number of finished calls and the result.
    """
    results: list[T] = []
    for result in each(function, calls, jobs):
        results.append(result)
        if done is not None:
            done(len(results), result)
    return results
