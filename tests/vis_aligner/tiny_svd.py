"""An untrained svd aligner, small enough for a processor."""

from __future__ import annotations

import torch

from embodiedreamer_gym.vis_aligner.svd import SvdAligner, import_diffusers


def tiny_svd(chunk: int = 7, seed: int = 0) -> SvdAligner:
    """An untrained svd aligner of a few million parameters: the same classes, small enough for a processor."""
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
    return SvdAligner(small, auto, chunk=chunk, steps=1)
