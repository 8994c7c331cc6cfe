"""The same work on many things at once, through joblib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from joblib import Parallel, delayed

T = TypeVar("T")


def many(
    function: Callable[..., T], calls: Sequence[tuple[Any, ...]], jobs: int = 1,
    done: Callable[[int, T], None] | None = None,
) -> list[T]:  # fmt: skip
    """Results of a function for many tuples of arguments, in their order; done: told each result's place as it comes.

    In processes on this machine, unless `joblib.parallel_config` names another backend: threads, or Dask or Ray on a
    cluster. The results are the same.
    """
    results: list[T] = []
    work: Any = Parallel(n_jobs=jobs, prefer="processes", return_as="generator")
    for result in work(delayed(function)(*c) for c in calls):
        results.append(result)
        if done is not None:
            done(len(results), result)
    return results
