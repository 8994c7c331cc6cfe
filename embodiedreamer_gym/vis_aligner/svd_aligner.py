"""Stable Video Diffusion's U-Net and autoencoder as an aligner: the paper's own model, in latents.

Source: Blattmann et al., Stable Video Diffusion, 2023; the paper's section on VisAligner: the condition
[I_r, c_1 .. c_{f-1}] is encoded frame by frame and concatenated with the noise along the channels. Here the frames
assembled from the last frame, plate, anchor and gallery are concatenated too.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Generator, Tensor, nn

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.aligner import Made, check_batch
from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import OBJECT, Condition
from embodiedreamer_gym.vis_aligner.latent_cache import LatentCache
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs, reprojected_frames, to_frames
from embodiedreamer_gym.vis_aligner.velocity import (
    clean_clip,
    draw_sigmas,
    noise_condition,
    noisy_and_velocity,
    sample_velocity,
    sigmas,
)

MASK_COLOURS = ((255, 60, 60), (60, 60, 255))  # of object and goal in the picture
MICRO = (
    6.0,
    127.0,
    0.0,
)  # as in SVD's training: frames per second minus one, motion bucket, noise on the condition (none is added)
CELL = 8  # pixels per side of a latent
INPUTS = Inputs()


@dataclass(frozen=True)
class SvdSettings:
    """Computation settings of an svd aligner."""

    bf16: bool = False
    """Whether matrix products and convolutions are computed in bfloat16; the weights stay as they are."""
    gradient_checkpointing: bool = False
    """Whether training recomputes activations instead of storing them."""
    decode_chunk_size: int = 8
    """Number of pictures that the autoencoder encodes or decodes at once; fewer need less memory."""

    def __post_init__(self) -> None:
        """Check."""
        if self.decode_chunk_size < 1:
            raise VisionError(f"decode_chunk_size is {self.decode_chunk_size}, but must be at least 1.")


class SvdAligner:
    """U-Net and autoencoder of Stable Video Diffusion; chunk: frames after the reference; steps: of diffusion.

    A U-Net with the 2 C input channels of Stable Video Diffusion (C channels of a latent) gets more, with zero weights,
    for the frames assembled from other pictures.
    Raises: VisionError for a U-Net with another number of channels.
    """

    learning_rate = 1e-5  # of AdamW, from Stable Video Diffusion's weights

    def __init__(self, unet: Any, vae: Any, chunk: int = 24, steps: int = 4, seed: int = 0, name: str = "svd",
                 settings: SvdSettings | None = None) -> None:  # fmt: skip
        latent = vae.config.latent_channels
        plain, wide = 2 * latent, (3 + INPUTS.sources) * latent + 1
        if unet.config.in_channels == plain:
            widen(unet, wide)
        if unet.config.in_channels != wide:
            raise VisionError(
                f"the U-Net has {unet.config.in_channels} input channels; for latents of {latent} channels it needs "
                f"{plain} (Stable Video Diffusion) or {wide} (svd aligner)."
            )
        self.network, self.vae = unet, vae.requires_grad_(False).eval()
        self.chunk, self.steps, self.seed, self.name = chunk, steps, seed, name
        self.settings = settings or SvdSettings()
        if self.settings.gradient_checkpointing:
            unet.enable_gradient_checkpointing()
        self.latents = LatentCache(self._encode, self.settings.decode_chunk_size)

    def __repr__(self) -> str:
        return f"SvdAligner({self.name!r}, {self.chunk} frames, {self.steps} steps)"

    @property
    def device(self) -> torch.device:
        """The network's device."""
        return next(self.network.parameters()).device

    def render(self, references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 for each condition of T frames, as one batch.

        Raises: VisionError when sizes or lengths differ, or a size is not a multiple of 8.
        """
        training = self.network.training
        self.network.eval()
        with torch.no_grad(), self._precision():
            given = self._given(references, conditions)
            shape = given.shape[1], self.vae.config.latent_channels, *given.shape[3:]
            noise = torch.randn(shape, generator=Generator().manual_seed(self.seed)).to(given)
            noise = noise.expand(len(given), *shape)
            made = sample_velocity(lambda y, sigma: self._velocity(y, sigma, given), noise, sigmas(self.steps))
            frames = self._decode(made)
        self.network.train(training)
        return frames

    def attempt(self, references: Sequence[References], conditions: Sequence[Condition], truth: Sequence[np.ndarray],
                generator: Generator) -> tuple[Tensor, Made]:  # fmt: skip
        """Mean squared error of v, at drawn noise levels; and the frames decoded from the predictions."""
        with self._precision():
            with torch.no_grad():
                given = self._given(references, conditions)
                frames = [np.concatenate([r.last[None], t]) for r, t in zip(references, truth, strict=True)]
                true = self._latents(np.stack(frames)) * self.vae.config.scaling_factor
            sigma = draw_sigmas(len(true), generator).to(true)
            noise = torch.randn(true.shape, generator=generator).to(true)
            noisy, velocity = noisy_and_velocity(true, sigma, noise)
            predicted = self._velocity(noisy, sigma, given)
        made = clean_clip(noisy, predicted.detach(), sigma)

        def frames_made() -> list[np.ndarray]:
            with torch.no_grad(), self._precision():
                return self._decode(made)

        return torch.mean((predicted - velocity) ** 2), frames_made

    # ---- inside ------------------------------------------------------------------------------------------------

    def _precision(self) -> AbstractContextManager[Any]:
        return torch.autocast(self.device.type, torch.bfloat16) if self.settings.bf16 else nullcontext()

    def _given(self, references: Sequence[References], conditions: Sequence[Condition]) -> Tensor:
        """Network inputs besides the noisy latents (B, 1 + T, C, h, w), concatenated along the channels.

        They are the unscaled latents of the paper's condition clip and of the frames assembled from other pictures, and
        the share of each cell where no picture shows robot or object.
        """
        check_batch(references, conditions)
        if any(n % CELL for n in conditions[0].size):
            raise VisionError(f"the svd aligner needs sizes that are multiples of {CELL}, not {conditions[0].size}.")
        clips, blank = [], []
        for reference, condition in zip(references, conditions, strict=True):
            lit = reference.lit(condition)
            still, sources, stale = reprojected_frames(reference, lit, INPUTS)
            frames = np.stack([with_mask_colours(lit), still, *sources.swapaxes(0, 1)], axis=1)
            first = np.broadcast_to(reference.last, (1, *frames.shape[1:]))
            clips.append(np.concatenate([first, frames]))
            blank.append(np.concatenate([np.zeros_like(stale[:1]), stale]))
        stale = F.avg_pool2d(torch.from_numpy(np.stack(blank)).float(), CELL)[:, :, None]
        return torch.cat([self._latents(np.stack(clips)).flatten(2, 3), stale.to(self.device)], dim=2)

    def _velocity(self, noisy: Tensor, sigma: Tensor, given: Tensor) -> Tensor:
        """The network's prediction (B, F, C, h, w)."""
        none = noisy.new_zeros(len(noisy), 1, int(self.network.config.cross_attention_dim))
        micro = noisy.new_tensor(MICRO).expand(len(noisy), 3)
        joined = torch.cat([noisy, given], dim=2)
        level = noise_condition(sigma)
        return self.network(joined, level, encoder_hidden_states=none, added_time_ids=micro).sample.float()

    def _latents(self, pictures: np.ndarray) -> Tensor:
        """Pictures (..., H, W, 3) uint8 as latents (..., C, h, w), not scaled."""
        found = self.latents(pictures.reshape(-1, *pictures.shape[-3:]))
        return found.to(self.device).unflatten(0, pictures.shape[:-3])

    def _encode(self, pictures: Tensor) -> Tensor:
        return self.vae.encode(pictures.to(self.device)).latent_dist.mode()

    def _decode(self, latents: Tensor) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 of each clip of latents (B, 1 + T, C, h, w), without the first."""
        pieces = (latents / self.vae.config.scaling_factor).split(self.settings.decode_chunk_size, dim=1)
        decoded = [
            self.vae.decode(piece.flatten(0, 1), num_frames=piece.shape[1]).sample.unflatten(0, piece.shape[:2])
            for piece in pieces
        ]
        return list(to_frames(torch.cat(decoded, dim=1).float()[:, 1:]))


def widen(unet: Any, channels: int) -> None:
    """Give a U-Net more input channels, in place; the new ones have no effect until they are trained."""
    old = unet.conv_in
    new = nn.Conv2d(channels, old.out_channels, old.kernel_size, old.stride, old.padding).to(old.weight)
    with torch.no_grad():
        new.weight.zero_()
        new.weight[:, : old.in_channels] = old.weight
        new.bias.copy_(old.bias)  # pyright: ignore[reportOptionalMemberAccess]
    unet.conv_in = new
    unet.register_to_config(in_channels=channels)


def with_mask_colours(condition: Condition) -> np.ndarray:
    """The paper's c_sim (T, H, W, 3) uint8: the simulated picture with the masks of object and goal in two colours."""
    picture = condition.rgb.copy()  # object pixels get the mask's colour alone
    for colour, mask in zip(MASK_COLOURS, (condition.classes == OBJECT, condition.classes > OBJECT), strict=True):
        picture[mask] = colour
    return picture
