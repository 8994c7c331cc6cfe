"""An svd aligner whose networks are a few convolutions: it can be trained in a second."""

from __future__ import annotations

from types import SimpleNamespace

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from embodiedreamer_gym.vis_aligner.svd_aligner import SvdAligner, SvdSettings

CHANNELS, WIDTH = 3, 32


class BlockMeans(nn.Module):
    """An autoencoder without weights: a latent is the mean colour of 8 x 8 pixels."""

    config = SimpleNamespace(latent_channels=CHANNELS, scaling_factor=2.0)

    def encode(self, pictures: Tensor) -> SimpleNamespace:
        """The latents, as diffusers gives them."""
        self.encoded = getattr(self, "encoded", 0) + len(pictures)
        return SimpleNamespace(latent_dist=SimpleNamespace(mode=lambda: F.avg_pool2d(pictures, 8)))

    def decode(self, latents: Tensor, num_frames: int) -> SimpleNamespace:
        """The pictures, as diffusers gives them."""
        self.pieces = [*getattr(self, "pieces", []), num_frames]
        return SimpleNamespace(sample=F.interpolate(latents, scale_factor=8.0, mode="nearest"))


class FewConvolutions(nn.Module):
    """A network with the call of diffusers' U-Net; `calls` holds what it was given."""

    def __init__(self) -> None:
        super().__init__()
        self.config = SimpleNamespace(in_channels=2 * CHANNELS, cross_attention_dim=4)
        self.conv_in = nn.Conv2d(2 * CHANNELS, WIDTH, 3, padding=1)
        self.level = nn.Linear(3, WIDTH)
        self.body = nn.Sequential(nn.SiLU(), nn.Conv2d(WIDTH, WIDTH, 1), nn.SiLU())
        self.out, self.calls = nn.Conv2d(2 * WIDTH, CHANNELS, 1), []

    def register_to_config(self, in_channels: int) -> None:
        """As of diffusers' networks."""
        self.config.in_channels = in_channels

    def forward(
        self, joined: Tensor, level: Tensor, encoder_hidden_states: Tensor, added_time_ids: Tensor
    ) -> SimpleNamespace:
        """A prediction of the noisy channels' size."""
        self.calls.append((joined.detach(), level, encoder_hidden_states, added_time_ids))
        told = self.level(torch.stack([level, level**2, torch.tanh(level)], 1))[:, None, :, None, None]
        x = self.conv_in(joined.flatten(0, 1)).unflatten(0, joined.shape[:2])
        x, gate = (x + told).flatten(0, 1), torch.sigmoid(told).expand_as(x).flatten(0, 1)
        return SimpleNamespace(sample=self.out(torch.cat([self.body(x), x * gate], 1)).unflatten(0, joined.shape[:2]))


def toy_svd(chunk: int = 3, steps: int = 4, settings: SvdSettings | None = None) -> SvdAligner:
    """The untrained aligner."""
    torch.manual_seed(0)
    return SvdAligner(FewConvolutions(), BlockMeans(), chunk, steps, settings=settings)
