"""The interface of all aligners: frames from references and conditions, and whole episodes chunk by chunk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from torch import Generator, Tensor, nn

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import Condition

MOST_FRAMES = 1000  # largest chunk of a model file
Made = Callable[[], list[np.ndarray]]  # computes the frames (T, H, W, 3) uint8 of each clip on request


class Aligner(Protocol):
    """A model that generates realistic frames from simulated ones; chunk: number of frames generated at once."""

    name: str
    chunk: int

    def render(self, references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 for each condition of T frames, as one batch.

        Raises: VisionError when sizes or lengths differ.
        """
        ...


class Trainable(Aligner, Protocol):
    """An aligner that can be trained; network: the trained weights."""

    network: nn.Module

    def attempt(self, references: Sequence[References], conditions: Sequence[Condition], truth: Sequence[np.ndarray],
                generator: Generator) -> tuple[Tensor, Made]:  # fmt: skip
        """Loss of a batch against the true frames (T, H, W, 3) uint8, at noise levels drawn from the generator; and the
        generated frames, as references of the next chunk.
        """
        ...


def check_batch(references: Sequence[References], conditions: Sequence[Condition]) -> None:
    """Raise VisionError unless all clips have one size and one length, and references the same size."""
    sizes = {c.size for c in conditions} | {r.size for r in references}
    lengths = {len(c) for c in conditions}
    if len(references) != len(conditions) or not conditions or len(sizes) > 1 or len(lengths) > 1:
        raise VisionError(
            f"a batch needs one reference per clip, and one size and length; it has {len(references)} references, "
            f"{len(conditions)} clips, sizes {sorted(sizes)}, lengths {sorted(lengths)}."
        )


def generate(
    aligner: Aligner, references: Sequence[References], conditions: Sequence[Condition]
) -> tuple[list[np.ndarray], list[References]]:
    """Frames (T, H, W, 3) of whole episodes, chunk by chunk; and the references after them.

    The last frame of each chunk is the reference of the next.
    """
    references, done = list(references), []
    for start in range(0, len(conditions[0]), aligner.chunk):
        parts = [r.lit(c.part(start, start + aligner.chunk)) for r, c in zip(references, conditions, strict=True)]
        frames = aligner.render(references, parts)
        references = [r.after(f, c) for r, f, c in zip(references, frames, parts, strict=True)]
        done.append(frames)
    return [np.concatenate(clip) for clip in zip(*done, strict=True)], references
