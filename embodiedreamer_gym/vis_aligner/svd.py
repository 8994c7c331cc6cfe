"""Stable Video Diffusion's classes as an aligner: the paper's own model, in latents, from a local folder.

Source: Blattmann et al., Stable Video Diffusion, 2023; the paper's section on VisAligner: the condition
[I_r, c_1 .. c_{f-1}] is encoded frame by frame and set beside the noise along the channels.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.io.files import read_json, write_json
from embodiedreamer_gym.vis_aligner.aligner import MOST_FRAMES, Made, check_batch
from embodiedreamer_gym.vis_aligner.clip import References
from embodiedreamer_gym.vis_aligner.condition import OBJECT, Condition
from embodiedreamer_gym.vis_aligner.diffusion import add_noise, draw_times, sample
from embodiedreamer_gym.vis_aligner.network_inputs import to_frames, to_tensor

SETTINGS = "embodiedreamer.json"
MASK_COLOURS = ((255, 60, 60), (60, 60, 255))  # added to the picture where object and goal are
MICRO = (6.0, 127.0, 0.02)  # SVD's own: frames per second less one, motion bucket, noise on the condition
MOST_LAYERS, MOST_CHANNELS = 64, 16_384  # whole numbers in a network's config.json
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
        clips = [
            np.concatenate([r.last[None], with_mask_colours(c)]) for r, c in zip(references, conditions, strict=True)
        ]
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


def with_mask_colours(condition: Condition) -> np.ndarray:
    """The paper's c_sim (T, H, W, 3) uint8: the simulated picture, masks of object and goal added to it pixel-wise."""
    picture = np.where((condition.classes >= OBJECT)[..., None], 0, condition.rgb).astype(np.int32)
    for number, colour in enumerate(MASK_COLOURS):
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
    chunk = settings.get("chunk", 24) if isinstance(settings, dict) else None
    if type(chunk) is not int or not 1 <= chunk <= MOST_FRAMES:
        raise VisionError(
            f"{folder / SETTINGS} must be a JSON object whose chunk is a whole number of 1 to {MOST_FRAMES}."
        )
    parts = [_load_part(kind, folder / name) for kind, name in ((unet, "unet"), (vae, "vae"))]
    return SvdAligner(*parts, chunk=chunk, steps=steps, seed=seed, name=folder.name)


def _load_part(kind: Any, folder: Path) -> Any:
    """A network of diffusers in a folder.

    Raises: VisionError where there is none, or its config.json asks for more weights than its files hold.
    """
    try:
        config = json.loads((folder / "config.json").read_text("utf-8"))
        for name, value in config.items():
            if any(n > (MOST_LAYERS if name.endswith("per_block") else MOST_CHANNELS) for n in _whole_numbers(value)):
                raise ValueError(f"{name} in {folder.name}/config.json is too large")
        with torch.device("meta"):  # takes no memory
            count = sum(weight.numel() for weight in kind.from_config(config).parameters())
        if count > sum(path.stat().st_size for path in folder.glob("*.safetensors")):  # a weight has a byte or more
            raise ValueError(f"{folder.name}/config.json asks for {count} weights, its files are smaller")
        return kind.from_pretrained(str(folder), local_files_only=True, use_safetensors=True)
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError, ArithmeticError) as error:
        what = " ".join(str(error).split())[:200]
        raise VisionError(f"{folder.parent} holds no svd aligner (folders unet and vae): {what}") from error


def _whole_numbers(value: Any) -> Iterator[int]:
    """Whole numbers in nested lists."""
    if isinstance(value, list):
        for one in value:
            yield from _whole_numbers(one)
    elif isinstance(value, int):
        yield value


def save_svd(aligner: SvdAligner, folder: str | Path) -> None:
    """Write U-Net, autoencoder and settings into a folder, as `load_svd` reads them."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    aligner.network.save_pretrained(folder / "unet", safe_serialization=True)
    aligner.vae.save_pretrained(folder / "vae", safe_serialization=True)
    write_json({"chunk": aligner.chunk}, folder / SETTINGS, VisionError)
