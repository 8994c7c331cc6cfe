"""Motion that the training recordings lack: if only held-out motion shows an error, move one recording to training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.decision import ODDS, independent_share, likelihood_ratio
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.search_state import Search, SearchState
from embodiedreamer_gym.diagnosis.verdict import FAR
from embodiedreamer_gym.phys_aligner.problem import CORRELATED
from embodiedreamer_gym.recordings import Recording, thin


def only_held_out_shows(state: SearchState) -> bool:
    """Whether at some joint the calibrated model is far worse than faultless robots on held-out motion only."""
    if state.by_effort:
        return False
    fitted, held = (np.quantile(chi2, 0.95, axis=0) for chi2 in (state.null.trained_chi2, state.null.chi2))
    return bool(np.any((state.trained.chi2 <= fitted) & (state.base.chi2 > FAR * held)))


def contradicted(search: Search, state: SearchState, singles: Sequence[Candidate]) -> Candidate | None:
    """The single effect that fits the training motion best, if that motion supports it and held-out motion does not.

    On the training motion it leaves no more error than faultless robots have, and it is more probable than the current
    model by Schwarz's criterion (BIC) with all its parameters. Either it is wrong, or the training motion does not
    determine all of it: for example, it may reach a limit in only one of two directions. A limit may be reached in one
    piece of time only, so the scatter over pieces is not used.
    """
    least, now = min(singles, key=lambda c: c.fit.cost), state.steps[-1] if state.steps else None
    if now is None or least.kind is now.kind or not state.is_exact_on_fitted(least.trained):
        return None
    parameters = len(least.problem.rows) - len(state.start[1].rows)
    needed = parameters * np.log(sum(r.duration for r in search.train) / CORRELATED)
    seen = likelihood_ratio(least.trained, now.trained, independent_share(search.train)).value
    held = likelihood_ratio(now.held_out, least.held_out, independent_share(search.test)).value
    return least if seen > needed and held > 2 * np.log(ODDS) else None


def learn_from_worst(
    search: Search, state: SearchState, train: Sequence[Recording], seconds: float
) -> tuple[Search, Recording] | None:  # fmt: skip
    """A search with one held-out recording moved to training, and that recording; None if this would not help.

    A limit that the training motion does not reach leaves no trace in it, so it cannot be fitted to it. The held-out
    recording with the largest error is moved if the current model, or the calibrated model at some joint, is as good as
    faultless robots on the training motion but not on the held-out motion, or if another effect is `contradicted`. The
    other recordings remain for testing.

    train: the complete training recordings; seconds: of motion that are used of each part.
    """
    if len(search.whole_test) < 2 or not (state.is_wrong_unseen or state.unseen or only_held_out_shows(state)):
        return None
    model, problem = (state.unseen.model, state.unseen.problem) if state.unseen else state.current[:2]
    most = np.quantile(state.null.chi2, 0.95, axis=0)
    errors = [float((evaluate(model, [r], problem.hold).chi2 / most).max()) for r in search.whole_test]
    worst = int(np.argmax(errors))
    test = [r for i, r in enumerate(search.whole_test) if i != worst]
    moved = search.whole_test[worst]
    parts = thin([*train, moved], seconds), thin(test, seconds)
    cache = RefitCache(search.cache.path, search.nominal, [*parts[1], *parts[0]], search.catalogue)
    return replace(search, train=parts[0], test=parts[1], whole_test=test, cache=cache, linearised=None), moved
