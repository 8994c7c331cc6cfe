"""Motion that the training recordings lack: where an error is in held-out motion alone, one of these recordings is learned from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState
from embodiedreamer_gym.recordings import Recording, thin


def learn_from_worst(
    search: Search, state: SearchState, train: Sequence[Recording], seconds: float
) -> tuple[Search, Recording] | None:  # fmt: skip
    """A search that learns from one held-out recording too, and that recording; None where this would not help.

    A limit that the training motion does not reach leaves no trace in it, and whatever is fitted to it says nothing about the
    limit. So where the model so far does as well on the training motion as faultless robots do, and not on the held-out motion,
    the held-out recording with the largest error is moved; the others judge.

    train: the whole training recordings; seconds: of motion that are used of each part.
    """
    if not state.is_wrong_unseen or len(search.whole_test) < 2:
        return None
    model, problem, _ = state.current
    most = np.quantile(state.null.chi2, 0.95, axis=0)
    errors = [float((evaluate(model, [r], problem.hold).chi2 / most).max()) for r in search.whole_test]
    worst = int(np.argmax(errors))
    test = [r for i, r in enumerate(search.whole_test) if i != worst]
    moved = search.whole_test[worst]
    parts = thin([*train, moved], seconds), thin(test, seconds)
    cache = RefitCache(search.cache.path, search.nominal, [*parts[1], *parts[0]], search.catalogue)
    return replace(search, train=parts[0], test=parts[1], whole_test=test, cache=cache, linearised=None), moved
