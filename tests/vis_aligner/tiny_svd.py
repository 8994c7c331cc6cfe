"""An untrained svd aligner, small enough for a processor."""

from __future__ import annotations

from typing import Any

import torch

from embodiedreamer_gym.vis_aligner.svd import import_diffusers
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdAligner, SvdSettings


def tiny_svd(chunk: int = 7, seed: int = 0, settings: SvdSettings | None = None) -> SvdAligner:
    """An untrained svd aligner of a few million parameters: the same classes, small enough for a processor."""
    return SvdAligner(*tiny_networks(chunk, seed), chunk=chunk, steps=1, settings=settings)


def tiny_networks(chunk: int = 7, seed: int = 0) -> tuple[Any, Any]:
    """U-Net and autoencoder as Stable Video Diffusion has them, but for their size."""
    _, unet, vae = import_diffusers()
    torch.manual_seed(seed)
    small = unet(
        sample_size=16, in_channels=8, out_channels=4, block_out_channels=(32, 64), layers_per_block=1,
        down_block_types=("CrossAttnDownBlockSpatioTemporal", "DownBlockSpatioTemporal"),
        up_block_types=("UpBlockSpatioTemporal", "CrossAttnUpBlockSpatioTemporal"), num_attention_heads=(2, 4),
        cross_attention_dim=32, projection_class_embeddings_input_dim=96, addition_time_embed_dim=32, num_frames=chunk + 1,
    )  # fmt: skip
    auto = vae(
        in_channels=3, out_channels=3, block_out_channels=(32, 32, 32, 32), layers_per_block=1, latent_channels=4,
        down_block_types=("DownEncoderBlock2D",) * 4, sample_size=64,
    )  # fmt: skip
    return small, auto
