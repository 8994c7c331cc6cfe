"""Stable Video Diffusion's classes as an aligner: the paper's own model, in latents, from a local folder.

Source: Blattmann et al., Stable Video Diffusion, 2023; the paper's section on VisAligner: the condition
[I_r, c_1 .. c_{f-1}] is encoded frame by frame and set beside the noise along the channels.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.io.files import read_json, write_json
from embodiedreamer_gym.vis_aligner.aligner import Made, check_batch
from embodiedreamer_gym.vis_aligner.clip import OBJECT, Condition, References
from embodiedreamer_gym.vis_aligner.diffusion import add_noise, draw_times, sample
from embodiedreamer_gym.vis_aligner.network_inputs import to_frames, to_tensor

SETTINGS = "embodiedreamer.json"
PAINT = ((255, 60, 60), (60, 60, 255))  # what the masks of object and goal add to the picture
MICRO = (
    6.0,
    127.0,
    0.02,
)  # frames per second less one, motion bucket, noise on the condition: what SVD was trained with
LEVELS = 1000.0  # a time of 1 as the U-Net's embedding takes it


def import_diffusers() -> Any:
    """The library of the U-Net and the autoencoder.

    Raises: MissingExtraError when the extra is not installed, or a torchvision of another torch hides it.
    """
    try:
        diffusers: Any = importlib.import_module("diffusers")
        return diffusers, diffusers.UNetSpatioTemporalConditionModel, diffusers.AutoencoderKLTemporalDecoder
    except (ImportError, RuntimeError) as error:
        if importlib.util.find_spec("diffusers") and importlib.util.find_spec("torchvision"):
            raise MissingExtraError(
                "diffusers cannot be loaded beside the torchvision installed here, which belongs to another torch; run: "
                "pip uninstall torchvision"
            ) from error
        raise MissingExtraError(
            "the svd aligner needs diffusers; run: pip install 'embodiedreamer-gym[svd]'"
        ) from error


class SvdAligner:
    """U-Net and autoencoder of Stable Video Diffusion; chunk: frames after the reference; steps: of diffusion."""

    def __init__(self, unet: Any, vae: Any, chunk: int = 24, steps: int = 4, seed: int = 0, name: str = "svd") -> None:
        if unet.config.in_channels != 2 * vae.config.latent_channels:
            raise VisionError(
                f"the U-Net takes {unet.config.in_channels} channels; noise and condition have "
                f"{2 * vae.config.latent_channels} together."
            )
        self.network, self.vae = unet, vae.requires_grad_(False).eval()
        self.chunk, self.steps, self.seed, self.name = chunk, steps, seed, name

    def __repr__(self) -> str:
        return f"SvdAligner({self.name!r}, {self.chunk} frames, {self.steps} steps)"

    def render(self, references: Sequence[References], conditions: Sequence[Condition]) -> list[np.ndarray]:
        """Frames (T, H, W, 3) uint8 for each condition of T frames, a batch at once.

        Raises: VisionError when sizes or lengths differ, or a size is no multiple of 8.
        """
        training = self.network.training
        self.network.eval()
        with torch.no_grad():
            given = self._encode(self._condition(references, conditions))
            noise = (
                torch.randn(given.shape[1:], generator=Generator().manual_seed(self.seed)).to(given).expand_as(given)
            )
            made = sample(lambda x, time: self._denoise(x, time, given), noise, self.steps)
            frames = self._decode(made)
        self.network.train(training)
        return list(to_frames(frames[:, 1:]))

    def attempt(self, references: Sequence[References], conditions: Sequence[Condition], truth: Sequence[np.ndarray],
                generator: Generator) -> tuple[Tensor, Made]:  # fmt: skip
        """Mean square of the latents that are left, at drawn noise levels; the frames that they decode to."""
        with torch.no_grad():
            given = self._encode(self._condition(references, conditions))
            frames = [np.concatenate([r.last[None], t]) for r, t in zip(references, truth, strict=True)]
            true = self._encode(torch.stack([to_tensor(f) for f in frames]))
        time = draw_times(len(true), generator).to(true)
        noise = torch.randn(true.shape, generator=generator).to(true)
        made = self._denoise(add_noise(true, time, noise), time, given)

        def frames_made() -> list[np.ndarray]:
            with torch.no_grad():
                return list(to_frames(self._decode(made.detach())[:, 1:]))

        return torch.mean((made - true) ** 2), frames_made

    # ---- inside ------------------------------------------------------------------------------------------------

    def _condition(self, references: Sequence[References], conditions: Sequence[Condition]) -> Tensor:
        """The paper's condition clips (B, 1 + T, 3, H, W)."""
        check_batch(references, conditions)
        if any(n % 8 for n in conditions[0].size):
            raise VisionError(f"the svd aligner takes sizes that are multiples of 8, not {conditions[0].size}.")
        clips = [np.concatenate([r.last[None], painted(c)]) for r, c in zip(references, conditions, strict=True)]
        device = next(self.network.parameters()).device
        return torch.stack([to_tensor(clip) for clip in clips]).to(device)

    def _denoise(self, noisy: Tensor, time: Tensor, given: Tensor) -> Tensor:
        """The clean latents (B, F, C, h, w)."""
        none = noisy.new_zeros(len(noisy), 1, int(self.network.config.cross_attention_dim))
        micro = noisy.new_tensor(MICRO).expand(len(noisy), 3)
        joined = torch.cat([noisy, given], dim=2)
        return self.network(joined, LEVELS * time, encoder_hidden_states=none, added_time_ids=micro).sample

    def _encode(self, frames: Tensor) -> Tensor:
        """Frames (B, F, 3, H, W) as latents (B, F, C, h, w)."""
        latents = self.vae.encode(frames.flatten(0, 1)).latent_dist.mode() * self.vae.config.scaling_factor
        return latents.unflatten(0, frames.shape[:2])

    def _decode(self, latents: Tensor) -> Tensor:
        """Latents (B, F, C, h, w) as frames (B, F, 3, H, W)."""
        frames = self.vae.decode(
            latents.flatten(0, 1) / self.vae.config.scaling_factor, num_frames=latents.shape[1]
        ).sample
        return frames.unflatten(0, latents.shape[:2])


def painted(condition: Condition) -> np.ndarray:
    """The paper's c_sim (T, H, W, 3) uint8: the simulated picture, masks of object and goal added to it pixel-wise."""
    picture = np.where((condition.classes >= OBJECT)[..., None], 0, condition.rgb).astype(np.int32)
    for number, colour in enumerate(PAINT):
        mask = condition.classes == OBJECT if number == 0 else condition.classes > OBJECT
        picture += mask[..., None] * np.array(colour)
    return np.clip(picture, 0, 255).astype(np.uint8)


def load_svd(folder: str | Path, steps: int = 4, seed: int = 0) -> SvdAligner:
    """An aligner of a local folder with `unet` and `vae` as diffusers saves them; nothing is downloaded.

    Raises: VisionError where something is missing, MissingExtraError without diffusers.
    """
    folder = Path(folder)
    _, unet, vae = import_diffusers()
    settings = read_json(folder / SETTINGS, VisionError) if (folder / SETTINGS).is_file() else {}
    try:
        parts = [kind.from_pretrained(str(folder / name), local_files_only=True, use_safetensors=True)
                 for kind, name in ((unet, "unet"), (vae, "vae"))]  # fmt: skip
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise VisionError(
            f"{folder} holds no svd aligner (folders unet and vae): {str(error).splitlines()[0]}"
        ) from error
    return SvdAligner(*parts, chunk=int(settings.get("chunk", 24)), steps=steps, seed=seed, name=folder.name)


def save_svd(aligner: SvdAligner, folder: str | Path) -> None:
    """Write U-Net, autoencoder and settings into a folder, as `load_svd` reads them."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    aligner.network.save_pretrained(folder / "unet", safe_serialization=True)
    aligner.vae.save_pretrained(folder / "vae", safe_serialization=True)
    write_json({"chunk": aligner.chunk}, folder / SETTINGS, VisionError)


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
