"""Summary of the measures of many episodes: mean, sd and count, and the distances that need all clips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.evaluate import UNITS, Measures
from embodiedreamer_gym.vis_aligner.metrics.frechet import frechet_distance
from embodiedreamer_gym.vis_aligner.metrics.video_features import FVD_LENGTH, RFVD_LENGTH

LENGTHS = {"rfvd": RFVD_LENGTH, "fvd": FVD_LENGTH}


@dataclass(frozen=True)
class Figure:
    """A measure over episodes: mean, sd (None for a single episode), and the number of episodes that have it."""

    mean: float
    sd: float | None
    count: int


@dataclass(frozen=True, eq=False, repr=False)
class Summary:
    """Measures over episodes.

    episodes: their number; figures: measure -> Figure, None where no episode has it; drift: measure -> mean, for each
    chunk of `chunk` frames, over the episodes that reach it; distances: "rfvd", "fvd" -> number over all clips, or
    None; reasons: measure -> why it is None; warnings: about the reliability of the figures.
    """

    episodes: int
    figures: Mapping[str, Figure | None]
    chunk: int
    drift: Mapping[str, tuple[float | None, ...]]
    distances: Mapping[str, float | None]
    reasons: Mapping[str, str]
    warnings: tuple[str, ...]

    def __getitem__(self, measure: str) -> float | None:
        """Mean of a measure, or a distance. Raises: VisionError for an unknown measure."""
        if measure in self.distances:
            return self.distances[measure]
        if measure not in self.figures:
            raise VisionError(
                f"there is no measure {measure!r}; give one of {', '.join([*self.figures, *self.distances])}."
            )
        figure = self.figures[measure]
        return None if figure is None else figure.mean

    def __repr__(self) -> str:
        return f"Summary({self.episodes} episodes, {len(self.figures)} measures)"

    def as_dict(self) -> dict[str, Any]:
        """The summary as JSON-compatible data, with units."""
        return {
            "episodes": self.episodes,
            "figures": {
                name: None if figure is None else {**vars(figure), "unit": UNITS[name.split(".")[0]]}
                for name, figure in self.figures.items()
            },
            "distances": {name: {"value": v, "unit": UNITS[name]} for name, v in self.distances.items()},
            "chunk": self.chunk,
            "drift": {name: list(curve) for name, curve in self.drift.items()},
            "reasons": dict(self.reasons),
            "warnings": list(self.warnings),
        }


def summarise(episodes: Sequence[Measures]) -> Summary:
    """Mean and sd over episodes; Frechet distances over the clips of all episodes.

    Raises: VisionError for no episode, or episodes of different chunks.
    """
    episodes = tuple(episodes)
    chunks = {measures.chunk for measures in episodes}
    if len(chunks) != 1:
        raise VisionError(
            f"{len(episodes)} episodes with chunks {sorted(chunks)}; at least one, all of one chunk, is expected."
        )
    reasons: dict[str, str] = {}
    for measures in episodes:
        reasons = {**measures.reasons, **reasons}
    names = dict.fromkeys(name for measures in episodes for name in measures.values)
    figures = {name: _figure([measures.values.get(name) for measures in episodes]) for name in names}
    distances, warnings = {}, []
    for name in LENGTHS:
        distances[name] = _distance(name, episodes, reasons, warnings)
    absent = {**figures, **distances}
    reasons = {name: reason for name, reason in reasons.items() if absent.get(name) is None}
    curves = dict.fromkeys(name for measures in episodes for name in measures.drift)
    drift = {name: _mean_curve([measures.drift.get(name, ()) for measures in episodes]) for name in curves}
    return Summary(len(episodes), figures, chunks.pop(), drift, distances, reasons, tuple(warnings))


def _figure(values: Sequence[float | None]) -> Figure | None:
    present = [value for value in values if value is not None]
    if not present:
        return None
    return Figure(float(np.mean(present)), float(np.std(present, ddof=1)) if len(present) > 1 else None, len(present))


def _distance(name: str, episodes: Sequence[Measures], reasons: dict[str, str], warnings: list[str]) -> float | None:
    """Distance over all clips; adds to `reasons` why there is none, and to `warnings` why it is unreliable."""
    features = [m.features[name] for m in episodes if name in m.features and len(m.features[name].truth)]
    count = sum(len(f.truth) for f in features)
    if count < 2:
        if any(name in m.features for m in episodes):
            reasons[name] = f"{count} clips of {LENGTHS[name]} frames; a Frechet distance needs at least two"
        return None
    generated, truth = (np.concatenate([getattr(f, part) for f in features]) for part in ("generated", "truth"))
    if count <= truth.shape[1]:
        warnings.append(
            f"{name} from {count} clips in {truth.shape[1]} dimensions: there are not more clips than dimensions, so "
            "the covariances are singular and the distance is too large; compare it only with distances of the same "
            "number of clips"
        )
    return frechet_distance(generated, truth)


def _mean_curve(curves: Sequence[Sequence[float | None]]) -> tuple[float | None, ...]:
    means = []
    for k in range(max(map(len, curves))):
        present = [value for curve in curves if k < len(curve) and (value := curve[k]) is not None]
        means.append(float(np.mean(present)) if present else None)
    return tuple(means)
