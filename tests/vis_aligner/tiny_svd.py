"""An untrained svd aligner, small enough for a processor."""

from __future__ import annotations

from typing import Any

import torch

from benchmarks.svd_networks import svd_networks
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdAligner, SvdSettings


def tiny_svd(chunk: int = 7, seed: int = 0, settings: SvdSettings | None = None) -> SvdAligner:
    """An untrained svd aligner of a few million parameters: the same classes, small enough for a processor."""
    return SvdAligner(*tiny_networks(chunk, seed), chunk=chunk, steps=1, settings=settings)


def tiny_networks(chunk: int = 7, seed: int = 0) -> tuple[Any, Any]:
    """U-Net and autoencoder as Stable Video Diffusion has them, but for their size."""
    torch.manual_seed(seed)
    return svd_networks(tiny=True, frames=chunk + 1)
