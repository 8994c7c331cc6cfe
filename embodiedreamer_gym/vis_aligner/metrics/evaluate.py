"""Evaluates a generated clip against the true one, and the baselines with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.baselines import copy_first, copy_last, raw_simulation
from embodiedreamer_gym.vis_aligner.metrics.checks import check_pair, clip_size
from embodiedreamer_gym.vis_aligner.metrics.drift import drift_curve
from embodiedreamer_gym.vis_aligner.metrics.ground_truth import GroundTruth
from embodiedreamer_gym.vis_aligner.metrics.image_metrics import (
    colour_shift,
    colour_shift_frames,
    gradient_psnr,
    psnr,
    psnr_frames,
    ssim_frames,
    temporal_error,
)
from embodiedreamer_gym.vis_aligner.metrics.lpips import NO_WEIGHTS, Lpips
from embodiedreamer_gym.vis_aligner.metrics.segmenter import overlaps
from embodiedreamer_gym.vis_aligner.metrics.video_features import NO_I3D, I3d, random_features

BASELINES = ("raw simulation", "copy first", "copy last")
OF_MANY = "a Frechet distance needs the clips of several episodes; see summarise"
UNITS = {
    "psnr": "dB", "ssim": "1", "gradient_psnr": "dB", "temporal_error": "1/255", "colour_shift": "1/255",
    "colour_shift_rgb": "1/255", "lpips": "1", "iou": "1", "iou_ceiling": "1", "rfvd": "(1/255)^2", "fvd": "1",
}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Features:
    """Features of a generated clip (n, D) and of the true one (n, D), for a Frechet distance over many clips."""

    generated: np.ndarray
    truth: np.ndarray

    def __repr__(self) -> str:
        return f"Features{self.generated.shape}"


@dataclass(frozen=True, eq=False, repr=False)
class Measures:
    """Measures of a generated clip against the true one.

    frames, size: of the clip; values: measure -> number or None, with the region after a dot ("psnr.moving",
    "iou.objects"); UNITS has the unit of the part before the dot; drift: measure -> one number per chunk of `chunk`
    frames, or None; reasons: measure -> why it is None; features: "rfvd", "fvd" -> features for these distances, which
    need all episodes.
    """

    frames: int
    size: tuple[int, int]
    values: Mapping[str, float | None]
    chunk: int
    drift: Mapping[str, tuple[float | None, ...]]
    reasons: Mapping[str, str]
    features: Mapping[str, Features] = field(default_factory=dict)

    def __getitem__(self, measure: str) -> float | None:
        """Value of a measure. Raises: VisionError for an unknown measure; the message lists the known ones."""
        if measure not in self.values:
            raise VisionError(f"there is no measure {measure!r}; give one of {', '.join(self.values)}.")
        return self.values[measure]

    def __repr__(self) -> str:
        return f"Measures({self.frames} x {self.size[0]}x{self.size[1]}, {len(self.values)} values)"

    def as_dict(self) -> dict[str, Any]:
        """The measures as JSON-compatible data, with units."""
        return {
            "frames": self.frames,
            "size": list(self.size),
            "values": dict(self.values),
            "units": {name: UNITS[name.split(".")[0]] for name in self.values},
            "chunk": self.chunk,
            "drift": {name: list(curve) for name, curve in self.drift.items()},
            "reasons": dict(self.reasons),
        }


def evaluate(
    generated: np.ndarray, truth: GroundTruth, chunk: int = 8, lpips: Lpips | None = None, i3d: I3d | None = None
) -> Measures:
    """Measure a generated clip (T, H, W, 3), uint8 RGB, against the true one.

    chunk: number of frames generated at once, for the drift; lpips, i3d: networks with local weights.
    Raises: VisionError when sizes differ or a network cannot take these frames.
    """
    generated, true = check_pair(generated, truth.frames)
    by_frame, ssims = psnr_frames(generated, true), ssim_frames(generated, true)
    values: dict[str, float | None] = {
        "psnr": float(by_frame.mean()),
        "ssim": float(ssims.mean()),
        "gradient_psnr": gradient_psnr(generated, true),
        "temporal_error": temporal_error(generated, true),
    }
    reasons = {} if values["temporal_error"] is not None else {"temporal_error": "a single frame does not change"}
    drift = {"psnr": drift_curve(by_frame, chunk), "ssim": drift_curve(ssims, chunk)}
    for part in (_regions, _overlaps, _colours):
        part(generated, truth, chunk, values, drift, reasons)
    values["lpips"] = None if lpips is None else float(lpips.distances(generated, true).mean())
    reasons |= {"lpips": NO_WEIGHTS} if lpips is None else {}
    features = {"rfvd": Features(random_features(generated), truth.random_features)}
    reasons |= {"rfvd": OF_MANY, "fvd": NO_I3D if i3d is None else OF_MANY}
    if i3d is not None:
        features["fvd"] = Features(i3d.features(generated), truth.i3d_features(i3d))
    curves = {name: tuple(_finite(v) for v in curve) for name, curve in drift.items()}
    size = (true.shape[2], true.shape[1])
    return Measures(len(true), size, values, chunk, curves, reasons, features)


def evaluate_all(
    clips: Mapping[str, np.ndarray], truth: GroundTruth, simulated: np.ndarray, chunk: int = 8,
    lpips: Lpips | None = None, i3d: I3d | None = None,
) -> dict[str, Measures]:  # fmt: skip
    """Measure the baselines and then each of the named clips (T, H, W, 3), e.g. of models: name -> Measures.

    simulated: the simulator's frames (T, h, w, 3) of the same states.
    Raises: VisionError when sizes differ, or a clip has a baseline's name.
    """
    if taken := set(clips) & set(BASELINES):
        raise VisionError(f"{', '.join(sorted(taken))}: this is a baseline's name; call the clip something else.")
    baselines = {
        "raw simulation": raw_simulation(simulated, truth.frames),
        "copy first": copy_first(truth.reference, truth.frames),
        "copy last": copy_last(truth.reference, truth.frames, chunk),
    }
    return {name: evaluate(clip, truth, chunk, lpips, i3d) for name, clip in {**baselines, **clips}.items()}


def _regions(generated: np.ndarray, truth: GroundTruth, chunk: int, values: dict, drift: dict, reasons: dict) -> None:
    """PSNR of the moving pixels, of each class and of unions of classes."""
    for name in ("moving", *truth.numbers):
        mask = truth.moving if name == "moving" else truth.mask(truth.numbers[name])
        key = f"psnr.{name}"
        if mask.any():
            values[key] = psnr(generated, truth.frames, mask)
            drift[key] = drift_curve(psnr_frames(generated, truth.frames, mask), chunk)
        else:
            values[key] = None
            reasons[key] = (
                "nothing moves" if name == "moving" else f"no pixel of {name} is in the {clip_size(truth.frames)}"
            )


def _overlaps(generated: np.ndarray, truth: GroundTruth, chunk: int, values: dict, drift: dict, reasons: dict) -> None:
    """IoU of the segmented classes, and the IoU that the true frames reach."""
    segmented = truth.find(generated)
    for name, numbers in truth.numbers.items():
        values[f"iou.{name}"], values[f"iou_ceiling.{name}"] = truth.iou(segmented, numbers), truth.ceiling[name]
        if values[f"iou.{name}"] is None:
            reasons |= {f"{key}.{name}": f"no true pixel belongs to {name}" for key in ("iou", "iou_ceiling")}
            continue
        curves = [_share_curve(*overlaps(segmented, truth.classes, number), chunk) for number in truth.seen(numbers)]
        seen = np.isfinite(curves).sum(axis=0)
        drift[f"iou.{name}"] = np.divide(
            np.nansum(curves, axis=0), seen, out=np.full(seen.shape, np.nan), where=seen > 0
        )


def _share_curve(both: np.ndarray, either: np.ndarray, chunk: int) -> np.ndarray:
    """Intersection over union in each chunk; nan where neither has a pixel."""
    return drift_curve(np.divide(both, either, out=np.full(len(both), np.nan), where=either > 0), chunk, either)


def _colours(generated: np.ndarray, truth: GroundTruth, chunk: int, values: dict, drift: dict, reasons: dict) -> None:
    """Colour shift of the background: the largest of the channels, and each channel."""
    keys = ("colour_shift", *(f"colour_shift_rgb.{c}" for c in "rgb"))
    if not truth.still.any():
        values |= dict.fromkeys(keys)
        reasons |= dict.fromkeys(keys, "no background stands still")
        return
    shift = colour_shift(generated, truth.frames, truth.still)
    values |= dict(zip(keys, [float(np.abs(shift).max()), *shift.tolist()], strict=True))
    by_chunk = drift_curve(
        colour_shift_frames(generated, truth.frames, truth.still), chunk, truth.still.sum(axis=(1, 2))
    )
    drift["colour_shift"] = np.abs(by_chunk).max(axis=1)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
