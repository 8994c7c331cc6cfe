"""Where a chunk has to be drawn at all: around what moves in the simulator since the reference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import Condition, Window
from embodiedreamer_gym.vis_aligner.reprojection import Change

MARGIN = 0.12  # of the picture's width around what moves, for its shadow
GRID = 16  # pixels, of which a window's sides are multiples, where the picture has room


def moving(references: References, condition: Condition) -> np.ndarray:
    """Pixels (H, W) at which some simulated frame shows something else than at the reference."""
    return np.any(Change(references.last_condition, condition).differs, axis=0)


def windows(references: Sequence[References], conditions: Sequence[Condition]) -> list[Window] | None:
    """A window of one size for every clip of a batch, around all that moves in it; None where nothing moves at all."""
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
