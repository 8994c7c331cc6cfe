"""Errors of a model on held-out recordings, which are used to compare effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

BLOCKS = 24  # pieces of held-out time from which the spread of a difference is estimated


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of one model on held-out recordings or on the recordings that it was fitted to.

    chi2 (n,): mean square residual of each joint in units of sensor noise; sigma (n,): sensor noise in the joint's unit
    (for efforts, it depends on the model's inertia); blocks (pieces, n), counts (pieces, n): sums of squares and
    numbers of samples of consecutive pieces of time.
    """

    chi2: np.ndarray
    sigma: np.ndarray
    blocks: np.ndarray
    counts: np.ndarray

    @property
    def rms(self) -> np.ndarray:
        """Root mean square error (n,) of each joint, in its unit."""
        return np.sqrt(self.chi2) * self.sigma

    @property
    def error(self) -> float:
        """Mean over joints of each joint's root-mean-square, in the joints' unit."""
        return float(self.rms.mean())

    @property
    def score(self) -> float:
        """Sum over joints of the logarithm of the mean square error; each error counts at least as the noise."""
        return score(self.chi2, self.sigma)


def score(chi2: np.ndarray, sigma: np.ndarray) -> float:
    """Sum over joints of the logarithm of the mean square error chi2 (n,) x sigma (n,)^2, each at least the noise."""
    return float(np.sum(np.log(np.maximum(chi2, 1.0) * sigma**2)))


def evaluate(model: RobotModel, recordings: Sequence[Recording], hold: str | None = None) -> HeldOut:
    """Simulate the recordings and summarise the errors of their usable samples."""
    signals = Signals(model, recordings)
    return summarise_errors(signals, signals.residuals(model, hold=hold)[0])


def summarise_errors(signals: Signals, residuals: np.ndarray) -> HeldOut:
    """Summarise residuals (N,), in units of sensor noise, of the usable samples of each recording."""
    pieces = max(2, BLOCKS // len(signals.recordings))
    blocks, counts, begin = [], [], 0
    for usable in signals.usable:
        time, joint = np.nonzero(usable)
        own = residuals[begin : begin + len(time)]
        begin += len(time)
        cell = time * pieces // len(usable) * usable.shape[1] + joint
        size = pieces * usable.shape[1]
        blocks.append(np.bincount(cell, own**2, minlength=size).reshape(pieces, -1))
        counts.append(np.bincount(cell, minlength=size).reshape(pieces, -1))
    squares, number = np.concatenate(blocks), np.concatenate(counts)
    chi2 = squares.sum(axis=0) / np.maximum(number.sum(axis=0), 1)
    return HeldOut(chi2, signals.sigma, squares, number)


def pooled(one: HeldOut, other: HeldOut) -> HeldOut:
    """Errors of one model on both sets of recordings."""
    blocks, counts = np.concatenate([one.blocks, other.blocks]), np.concatenate([one.counts, other.counts])
    return HeldOut(blocks.sum(axis=0) / np.maximum(counts.sum(axis=0), 1), other.sigma, blocks, counts)


def gain(before: HeldOut, after: HeldOut) -> tuple[float, float]:
    """Fall of the score and its standard error, by a jackknife over the pieces of held-out time."""
    fall = before.score - after.score
    pieces = len(before.blocks)
    counts = before.counts.sum(axis=0) - before.counts
    number = np.maximum(counts, 1)
    without = [
        score((before.blocks.sum(0) - before.blocks[k]) / number[k], before.sigma)
        - score((after.blocks.sum(0) - after.blocks[k]) / number[k], after.sigma)
        for k in range(pieces)
    ]
    return fall, float(np.sqrt((pieces - 1) / pieces * np.sum((np.array(without) - np.mean(without)) ** 2)))
