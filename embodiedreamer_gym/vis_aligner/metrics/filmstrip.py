"""Picture strips: rows of frames side by side, with labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_frames, clip_size

GAP = 2  # pixels of white between pictures
PAPER, INK = 255, 40
FONT = cv2.FONT_HERSHEY_SIMPLEX
SCALE = 0.4  # of the font: capitals of 9 pixels


def strip(rows: Mapping[str, np.ndarray], columns: int | Sequence[int] = 8, zoom: int = 1) -> np.ndarray:
    """Picture (h, w, 3), uint8, of clips (T, H, W, 3) one above the other, labelled by name and frame number.

    columns: numbers of the frames to show, or how many, spread evenly from the first to the last; zoom: integer factor
    by which each frame is enlarged, without interpolation.
    Raises: VisionError when clips differ in length or size, or a frame does not exist.
    """
    clips = {name: check_frames(frames, name) for name, frames in rows.items()}
    shapes = {frames.shape for frames in clips.values()}
    if len(shapes) != 1:
        sizes = ", ".join(f"{name} {clip_size(frames)}" for name, frames in clips.items()) or "none"
        raise VisionError(f"clips of one length and size are expected, at least one; given: {sizes}.")
    count = shapes.pop()[0]
    chosen = _chosen(columns, count)
    if zoom < 1:
        raise VisionError(f"zoom is {zoom}; a whole number of 1 or more is expected.")
    body = [np.hstack([_framed(frames[k], zoom) for k in chosen]) for frames in clips.values()]
    margin = max(_extent(name)[0] for name in clips) + 10
    height = body[0].shape[0]
    lines = [np.hstack([_label(name, margin, height), line]) for name, line in zip(clips, body, strict=True)]
    width = body[0].shape[1] // len(chosen)
    heads = [_label(str(k), width, _extent("0")[1] + 8, middle=True) for k in chosen]
    return np.vstack([np.hstack([_label("frame", margin, heads[0].shape[0]), *heads]), *lines])


def _chosen(columns: int | Sequence[int], count: int) -> list[int]:
    if isinstance(columns, int):
        chosen = [round(k) for k in np.linspace(0, count - 1, min(max(columns, 0), count)).tolist()]
    else:
        chosen = [int(k) for k in columns]
    if not chosen or not all(0 <= k < count for k in chosen):
        raise VisionError(f"frames {chosen} are requested; give one or more of 0 .. {count - 1}.")
    return chosen


def _framed(frame: np.ndarray, zoom: int) -> np.ndarray:
    large = frame.repeat(zoom, axis=0).repeat(zoom, axis=1)
    return np.pad(large, ((0, GAP), (0, GAP), (0, 0)), constant_values=PAPER)


def _extent(text: str) -> tuple[int, int]:
    """Width and height of a label, pixels."""
    (width, height), _ = cv2.getTextSize(text, FONT, SCALE, 1)
    return width, height


def _label(text: str, width: int, height: int, middle: bool = False) -> np.ndarray:
    paper = np.full((height, width, 3), PAPER, np.uint8)
    wide, high = _extent(text)
    place = ((width - wide) // 2 if middle else 4, (height + high) // 2)
    return cv2.putText(paper, text, place, FONT, SCALE, (INK, INK, INK), 1, cv2.LINE_AA)
