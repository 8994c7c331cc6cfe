"""Intervals of shares and medians."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def clopper_pearson(hits: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share.

    Source: Clopper and Pearson, Biometrika 26, 1934.
    """
    from scipy.stats import beta

    low = beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, trials - hits) if hits < trials else 1.0
    return float(low), float(high)


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """95 % interval of a median, from order statistics; for fewer than six values, the range of the values."""
    from scipy.stats import binom

    given = np.sort(np.asarray(values, float))
    k = max(int(binom.ppf(0.025, len(given), 0.5)), 1)
    return float(given[k - 1]), float(given[-k])
