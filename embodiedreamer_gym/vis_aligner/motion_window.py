"""Windows of a chunk that must be generated: around everything that has moved in the simulator since the reference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import Condition, Window
from embodiedreamer_gym.vis_aligner.reprojection import Change

MARGIN = 0.12  # of the picture's width around what moves, for its shadow
GRID = 16  # pixels: a window's sides are multiples of this, unless the picture is too small


def moving(references: References, condition: Condition) -> np.ndarray:
    """Pixels (H, W) at which any simulated frame differs from the reference's simulated view."""
    return np.any(Change(references.last_condition, condition).differs, axis=0)


def windows(references: Sequence[References], conditions: Sequence[Condition]) -> list[Window] | None:
    """A window for every clip of a batch, all of one size, around everything that moves; None if nothing moves."""
    width, height = conditions[0].size
    margin = round(MARGIN * width)
    boxes = []
    for reference, condition in zip(references, conditions, strict=True):
        moved = moving(reference, condition)
        spans = [np.flatnonzero(moved.any(axis=axis)) for axis in (1, 0)]
        boxes.append([(s[0] - margin, s[-1] + 1 + margin) if len(s) else None for s in spans])
    if all(box[0] is None for box in boxes):
        return None
    sides = []
    for axis, whole in enumerate((height, width)):
        longest = max(min(b[axis][1], whole) - max(b[axis][0], 0) for b in boxes if b[axis] is not None)
        sides.append(min(whole, -(-longest // GRID) * GRID))
    return [(_slice(box[0], sides[0], height), _slice(box[1], sides[1], width)) for box in boxes]


def _slice(span: tuple[int, int] | None, side: int, whole: int) -> slice:
    """`side` pixels around a span, inside the picture."""
    middle = whole // 2 if span is None else (max(span[0], 0) + min(span[1], whole)) // 2
    start = int(np.clip(middle - side // 2, 0, whole - side))
    return slice(start, start + side)
