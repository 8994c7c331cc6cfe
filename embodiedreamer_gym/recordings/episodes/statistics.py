"""Statistics of an episode and of a set, as LeRobot stores them beside the data.

Source: lerobot/datasets/compute_stats.py of huggingface/lerobot 0.6.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
FEWEST, MOST, POWER = 100, 10_000, 0.75  # frames of an episode that are sampled: T ** POWER, between these
COARSE, LARGE = 150, 300  # pixels; frames of LARGE or more are subsampled to about COARSE
LEVELS = 256

Statistics = dict[str, np.ndarray]


def number_statistics(values: np.ndarray) -> Statistics:
    """Statistics (n,) of numbers (T, n)."""
    values = np.asarray(values, float)
    statistics = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    statistics |= {name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()}
    return {**statistics, "count": np.array([len(values)])}


def sampled_frames(length: int) -> set[int]:
    """Numbers of the frames of an episode that are sampled for its statistics."""
    count = max(min(FEWEST, length), min(int(length**POWER), MOST))
    return set(np.round(np.linspace(0, length - 1, count)).astype(int).tolist())


class FrameStatistics:
    """Counts the levels of each colour over frames, one frame at a time."""

    def __init__(self) -> None:
        self._counts = np.zeros((3, LEVELS), np.int64)
        self._frames = 0

    def add(self, frame: np.ndarray) -> None:
        """Count a frame (H, W, 3) uint8."""
        longest = max(frame.shape[:2])
        stride = longest // COARSE if longest >= LARGE else 1
        for channel in range(3):
            self._counts[channel] += np.bincount(frame[::stride, ::stride, channel].ravel(), minlength=LEVELS)
        self._frames += 1

    def result(self) -> Statistics:
        """Statistics (3, 1, 1) of the colours, 0..1."""
        levels = np.arange(LEVELS) / (LEVELS - 1)
        total, below = self._counts.sum(1), self._counts.cumsum(1)
        mean = self._counts @ levels / total
        variance = np.maximum(self._counts @ levels**2 / total - mean**2, 0.0)
        at = {name: np.argmax(below >= share * total[:, None], axis=1) for name, share in QUANTILES.items()}
        at |= {
            "min": np.argmax(self._counts > 0, axis=1),
            "max": LEVELS - 1 - np.argmax(self._counts[:, ::-1] > 0, axis=1),
        }
        statistics = {"mean": mean, "std": np.sqrt(variance)} | {name: levels[level] for name, level in at.items()}
        return {name: value.reshape(3, 1, 1) for name, value in statistics.items()} | {
            "count": np.array([self._frames])
        }


def combine_statistics(parts: Sequence[Statistics]) -> Statistics:
    """Statistics of a set from those of its parts; quantiles are means of quantiles, as LeRobot's."""
    counts = np.array([part["count"][0] for part in parts], float)
    weights = counts / counts.sum()

    def mean(name: str) -> np.ndarray:
        return sum((w * part[name] for w, part in zip(weights, parts, strict=True)), np.zeros(()))

    centre = mean("mean")
    spread = sum(
        (w * (p["std"] ** 2 + (p["mean"] - centre) ** 2) for w, p in zip(weights, parts, strict=True)), np.zeros(())
    )
    return {
        "min": np.min([part["min"] for part in parts], axis=0), "max": np.max([part["max"] for part in parts], axis=0),
        "mean": centre, "std": np.sqrt(spread), **{name: mean(name) for name in QUANTILES},
        "count": np.array([int(counts.sum())]),
    }  # fmt: skip
