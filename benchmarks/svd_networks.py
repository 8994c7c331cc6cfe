"""Untrained networks of Stable Video Diffusion's classes: full size for timing, tiny for tests."""

from __future__ import annotations

from typing import Any

from embodiedreamer_gym.vis_aligner.svd import import_diffusers

FULL = {"num_attention_heads": (5, 10, 20, 20)}, {"block_out_channels": (128, 256, 512, 512), "layers_per_block": 2}
TINY = (
    {
        "block_out_channels": (32, 64), "layers_per_block": 1, "num_attention_heads": (2, 4), "cross_attention_dim": 32,
        "down_block_types": ("CrossAttnDownBlockSpatioTemporal", "DownBlockSpatioTemporal"),
        "up_block_types": ("UpBlockSpatioTemporal", "CrossAttnUpBlockSpatioTemporal"),
        "projection_class_embeddings_input_dim": 96, "addition_time_embed_dim": 32,
    },
    {"block_out_channels": (32, 32, 32, 32), "layers_per_block": 1},
)  # fmt: skip


def svd_networks(tiny: bool = False, frames: int = 25) -> tuple[Any, Any]:
    """U-Net and autoencoder, with the sizes of stable-video-diffusion-img2vid-xt unless tiny."""
    _, unet, vae = import_diffusers()
    first, second = TINY if tiny else FULL
    encoder = {"down_block_types": ("DownEncoderBlock2D",) * 4, "latent_channels": 4}
    return unet(in_channels=8, out_channels=4, num_frames=frames, **first), vae(**encoder, **second)
