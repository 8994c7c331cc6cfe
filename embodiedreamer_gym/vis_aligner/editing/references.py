"""Applies an edit to all pictures of references: the last frame, the anchor and the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import CLASS_NAMES, ROBOT, TABLE, Condition
from embodiedreamer_gym.vis_aligner.editing.editor import Masks, ReferenceEditor, apply

ALIKE, NEARLY = 0.3, 3.0  # share of the change, and levels, by which the plate's edit may differ from the frame's


def edited(
    references: References, editor: ReferenceEditor, seed: int, prompt: str | None = None,
    names: Sequence[str] = CLASS_NAMES,
) -> References:  # fmt: skip
    """References of an episode's start with an edit applied; they are used like any others.

    names: of the classes; up to the robot's, as in CLASS_NAMES. The plate, which is the background behind robot and
    objects, is edited as a picture without them, with the same draws. If the editor's result differs from the first
    frame's, as an image model's may, the plate gets the first frame's change instead, inpainted behind robot and
    objects.
    Raises: VisionError where the editor returns no picture of the same size.
    """
    last = _edit(references.last, references.last_condition, editor, seed, prompt, names)
    anchor = last
    if references.anchor is not references.last:
        anchor = _edit(references.anchor, references.anchor_condition, editor, seed, prompt, names)
    classes, seen = references.anchor_condition.classes[0], references.seen
    before = np.where(seen[..., None], references.plate, references.anchor)
    after = apply(editor, before, _behind(classes, names), seed, prompt)
    free = (classes < ROBOT) & seen
    change = anchor.astype(np.float32) - references.anchor
    apart = np.abs(after.astype(np.float32) - before - change)[free].mean() if free.any() else 0.0
    if apart > NEARLY + ALIKE * np.abs(change)[free].mean():
        after = _extended(before, change, free)
    return replace(references, last=last, anchor=anchor, plate=np.where(seen[..., None], after, references.plate))


def masks_of(condition: Condition, names: Sequence[str] = CLASS_NAMES) -> dict[str, np.ndarray]:
    """Masks (H, W) of the classes in a condition's first frame, by name."""
    return {name: condition.classes[0] == number for number, name in enumerate(names)}


def _edit(
    frame: np.ndarray, condition: Condition, editor: ReferenceEditor, seed: int, prompt: str | None,
    names: Sequence[str],
) -> np.ndarray:  # fmt: skip
    return apply(editor, frame, masks_of(condition, names), seed, prompt)


def _behind(classes: np.ndarray, names: Sequence[str]) -> Masks:
    """Masks of the scene without robot and objects; the table, assumed to be convex, is extended behind them."""
    table = classes == TABLE
    whole = np.zeros(classes.shape, np.uint8)
    if table.any():
        outline = cv2.convexHull(np.argwhere(table)[:, ::-1].astype(np.int32))
        cv2.fillConvexPoly(whole, outline, 1)
    on_table = np.where(classes < ROBOT, table, whole > 0)
    nothing = np.zeros_like(on_table)
    return {name: (~on_table, on_table)[number] if number < ROBOT else nothing for number, name in enumerate(names)}


def _extended(before: np.ndarray, change: np.ndarray, free: np.ndarray) -> np.ndarray:
    """A picture with a change (H, W, 3) added: the known change at free pixels, inpainted from these elsewhere."""
    coded = np.clip(np.round(change / 2 + 128), 0, 255).astype(np.uint8)
    whole = 2.0 * (cv2.inpaint(coded, (~free).astype(np.uint8), 3, cv2.INPAINT_TELEA).astype(np.float32) - 128)
    filled = np.where(free[..., None], change, whole)
    return np.clip(np.round(before + filled), 0, 255).astype(np.uint8)
