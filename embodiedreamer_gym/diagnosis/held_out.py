"""Errors of a model on held-out recordings, by which effects are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.phys_aligner.signals import LARGEST, Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

BLOCKS = 24  # pieces of held-out time from which the spread of a difference is estimated


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of one model on held-out recordings.

    chi2 (n,): mean square residual of each joint in sensor noises; sigma (n,): that noise, in the joint's unit, which for
    efforts depends on the model's inertia; blocks (pieces, n), counts (pieces, n): sums of squares and samples of consecutive
    pieces of time.
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
        """Sum over joints of the logarithm of the mean square error; below the noise nothing counts."""
        return score(self.chi2, self.sigma)


def score(chi2: np.ndarray, sigma: np.ndarray) -> float:
    """Sum over joints of the logarithm of the mean square error, chi2 (n,) in units of sigma (n,), each at least the noise."""
    return float(np.sum(np.log(np.maximum(chi2, 1.0) * sigma**2)))


def evaluate(model: RobotModel, recordings: Sequence[Recording], hold: str | None = None) -> HeldOut:
    """Run the recordings and sum up the errors of their usable samples."""
    signals = Signals(model, recordings)
    errors = signals.errors(signals.runs(model, hold=hold))
    pieces = max(2, BLOCKS // len(recordings))
    blocks, counts = [], []
    for error, usable in zip(errors, signals.usable, strict=True):
        e = np.clip(np.where(usable, error[0] / signals.sigma, 0.0), -LARGEST, LARGEST)
        for part in np.array_split(np.arange(len(e)), pieces):
            blocks.append(np.sum(e[part] ** 2, axis=0))
            counts.append(usable[part].sum(axis=0))
    total, number = np.sum(blocks, axis=0), np.maximum(np.sum(counts, axis=0), 1)
    chi2 = total / number
    return HeldOut(chi2, signals.sigma, np.array(blocks), np.array(counts))


def gain(before: HeldOut, after: HeldOut) -> tuple[float, float]:
    """Fall of the score and its standard error, by a jackknife over pieces of the same held-out time."""
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
