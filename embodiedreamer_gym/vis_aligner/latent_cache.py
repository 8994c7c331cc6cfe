"""Cache of the latents of pictures: a frozen autoencoder always encodes the same picture to the same latent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from embodiedreamer_gym.vis_aligner.network_inputs import to_tensor

MOST_BYTES = 2 << 30  # of cached latents


class LatentCache:
    """Latents by picture content, on the CPU; the least recently used are dropped first.

    encode: pictures (N, 3, H, W) in -1 .. 1 -> latents (N, C, h, w).
    at_once: number of pictures that are encoded together.
    most: largest size in bytes.
    """

    def __init__(self, encode: Callable[[Tensor], Tensor], at_once: int, most: int = MOST_BYTES) -> None:
        self.encode, self.at_once, self.most = encode, at_once, most
        self._latents: dict[tuple[int, tuple[int, ...]], Tensor] = {}

    def __len__(self) -> int:
        return len(self._latents)

    def clear(self) -> None:
        """Drop all latents."""
        self._latents.clear()

    def __call__(self, pictures: np.ndarray) -> Tensor:
        """Latents (N, C, h, w) float32 of pictures (N, H, W, 3) uint8."""
        keys = [(hash(one.tobytes()), one.shape) for one in pictures]
        missing = {key: one for key, one in zip(keys, pictures, strict=True) if key not in self._latents}
        names, those = list(missing), list(missing.values())
        for start in range(0, len(those), self.at_once):
            made = self.encode(to_tensor(np.stack(those[start : start + self.at_once]))).float().cpu()
            self._latents.update(
                zip(names[start:], (one.clone() for one in made), strict=False)
            )  # not views of one tensor
        for key in keys:  # the newest are last
            self._latents[key] = self._latents.pop(key)
        found = torch.stack([self._latents[key] for key in keys])
        most = self.most // (found[0].numel() * found.element_size())
        for key in list(self._latents)[: max(0, len(self._latents) - most)]:
            del self._latents[key]
        return found
