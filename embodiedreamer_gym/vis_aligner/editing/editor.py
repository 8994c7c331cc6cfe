"""The interface of edits: an edit is a function of a picture, its masks and a random generator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.condition import CLASS_NAMES, ROBOT

Masks = Mapping[str, np.ndarray]  # name -> (H, W) bool; background, table, robot, then the objects
ReferenceEditor = Callable[[np.ndarray, Masks, np.random.Generator, str | None], np.ndarray]
SCENE = CLASS_NAMES[: ROBOT + 1]  # the names that every scene has


@dataclass(frozen=True)
class Chain:
    """Several edits, one after the other; each draws its own random numbers."""

    editors: tuple[ReferenceEditor, ...]

    def __init__(self, editors: Sequence[ReferenceEditor]) -> None:
        object.__setattr__(self, "editors", tuple(editors))

    def __repr__(self) -> str:
        return f"Chain([{', '.join(map(describe, self.editors))}])"

    def __call__(self, image: np.ndarray, masks: Masks, rng: np.random.Generator, prompt: str | None) -> np.ndarray:
        """The picture (H, W, 3) after all edits.

        Raises: VisionError where one of them returns no picture of the same size.
        """
        for editor, own in zip(self.editors, rng.spawn(len(self.editors)), strict=True):
            image = _checked(editor, image, masks, own, prompt)
        return image

    def draws(self, masks: Masks, rng: np.random.Generator) -> dict[str, Any]:
        """The random parameters that each edit draws."""
        drawn = zip(self.editors, rng.spawn(len(self.editors)), strict=True)
        return {f"{number} {describe(e)}": _draws(e, masks, own) for number, (e, own) in enumerate(drawn, 1)}


def apply(editor: ReferenceEditor, image: np.ndarray, masks: Masks, seed: int, prompt: str | None = None) -> np.ndarray:
    """The edited picture (H, W, 3) uint8; with the same seed, every picture gets the same draws.

    Raises: VisionError where the editor returns no picture of the same size.
    """
    return _checked(editor, image, masks, np.random.default_rng(seed), prompt)


def draws_of(editor: ReferenceEditor, masks: Masks, seed: int) -> dict[str, Any]:
    """The random parameters that `apply` draws with a seed, for JSON; empty for an editor without a method `draws`."""
    return _draws(editor, masks, np.random.default_rng(seed))


def describe(editor: ReferenceEditor) -> str:
    """Text that describes an editor and is the same in every run."""
    name = getattr(editor, "__qualname__", None)  # of a function, whose repr would contain an address
    return f"{editor.__module__}.{name}" if name else repr(editor)


def objects_in(masks: Masks, names: Sequence[str] | None) -> list[str]:
    """Names of the objects of a scene: all, or the given names.

    Raises: VisionError for a name that the scene does not have.
    """
    objects = [name for name in masks if name not in SCENE]
    for name in names or ():
        if name not in masks:
            raise VisionError(f"the scene has no '{name}' to edit; it has {', '.join(masks)}.")
    return objects if names is None else list(names)


def things(masks: Masks) -> np.ndarray:
    """Pixels (H, W) of robot and objects."""
    shown = [mask for name, mask in masks.items() if name not in SCENE[:ROBOT]]
    return np.any(shown, axis=0) if shown else np.zeros(next(iter(masks.values())).shape, bool)


def _checked(
    editor: ReferenceEditor, image: np.ndarray, masks: Masks, rng: np.random.Generator, prompt: str | None
) -> np.ndarray:
    edited = editor(image.copy(), masks, rng, prompt)
    if not isinstance(edited, np.ndarray) or edited.shape != image.shape or edited.dtype != image.dtype:
        given = f"{edited.shape} {edited.dtype}" if isinstance(edited, np.ndarray) else type(edited).__name__
        raise VisionError(
            f"editor {describe(editor)} returned {given}; a picture {image.shape} {image.dtype} is expected."
        )
    return edited


def _draws(editor: ReferenceEditor, masks: Masks, rng: np.random.Generator) -> dict[str, Any]:
    draws = getattr(editor, "draws", None)
    return {} if draws is None else dict(draws(masks, rng))
