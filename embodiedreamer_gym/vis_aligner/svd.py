"""Loads and saves the U-Net and autoencoder of Stable Video Diffusion, as diffusers folders with a settings file."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.io.files import read_json, write_json
from embodiedreamer_gym.learning.device import find_device
from embodiedreamer_gym.vis_aligner.aligner import MOST_FRAMES
from embodiedreamer_gym.vis_aligner.svd_aligner import CELL, SvdAligner, SvdSettings

SETTINGS = "embodiedreamer.json"
PREDICTION = "v"  # what the network predicts; older settings files have no such entry and predict the clean latents
STEPS = 4
MOST_LAYERS, MOST_CHANNELS = 64, 16_384  # limits of integers in a network's config.json


def import_diffusers() -> Any:
    """diffusers, and its classes of the U-Net and the autoencoder.

    Raises: MissingExtraError when the extra is not installed, or a torchvision for another torch prevents the import.
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


def load_svd(folder: str | Path, steps: int | None = None, seed: int = 0, device: str = "cpu",
             settings: SvdSettings | None = None) -> SvdAligner:  # fmt: skip
    """An aligner from a local folder with `unet` and `vae` as diffusers saves them; nothing is downloaded.

    Raises: VisionError where something is missing or the network does not predict v, MissingExtraError without
    diffusers.
    """
    folder, where = Path(folder), find_device(device, VisionError)
    _, unet_kind, vae_kind = import_diffusers()
    stored = read_json(folder / SETTINGS, VisionError) if (folder / SETTINGS).is_file() else {"prediction": PREDICTION}
    chunk = stored.get("chunk", 24) if isinstance(stored, dict) else None
    if type(chunk) is not int or not 1 <= chunk <= MOST_FRAMES:
        raise VisionError(
            f"{folder / SETTINGS} must be a JSON object whose chunk is a whole number from 1 to {MOST_FRAMES}."
        )
    if stored.get("prediction") != PREDICTION:
        raise VisionError(
            f"{folder} was trained to predict the clean latents, as svd aligners of former releases, and this release predicts v, "
            "as Stable Video Diffusion does; train it again from Stable Video Diffusion's weights: "
            "embodiedreamer vis train EPISODES --model svd --from DIR."
        )
    unet, vae = (_load_part(kind, folder / name).to(where) for kind, name in ((unet_kind, "unet"), (vae_kind, "vae")))
    if 2 ** (len(vae.config.down_block_types) - 1) != CELL:
        raise VisionError(
            f"{folder / 'vae'} is not an autoencoder of Stable Video Diffusion, whose latents are {CELL} pixels wide."
        )
    return SvdAligner(unet, vae, chunk, STEPS if steps is None else steps, seed, folder.name, settings)


def _load_part(kind: Any, folder: Path) -> Any:
    """A diffusers network from a folder.

    Raises: VisionError where there is none, or its config.json needs more weights than its files hold.
    """
    try:
        config = read_json(folder / "config.json", VisionError)
        for name, value in config.items():
            if any(n > (MOST_LAYERS if name.endswith("per_block") else MOST_CHANNELS) for n in _whole_numbers(value)):
                raise ValueError(f"{name} in {folder.name}/config.json is too large")
        with torch.device("meta"):  # takes no memory
            count = sum(weight.numel() for weight in kind.from_config(config).parameters())
        if count > sum(path.stat().st_size for path in folder.glob("*.safetensors")):  # a weight has a byte or more
            raise ValueError(f"{folder.name}/config.json asks for {count} weights, but its files are smaller")
        options = {"use_safetensors": True, "torch_dtype": torch.float32, "low_cpu_mem_usage": False}
        return kind.from_pretrained(str(folder), local_files_only=True, **options)
    except (
        VisionError,
        OSError,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        RuntimeError,
        ArithmeticError,
    ) as error:
        what = " ".join(str(error).split())[:200]
        raise VisionError(f"{folder.parent} holds no svd aligner (folders unet and vae): {what}") from error


def _whole_numbers(value: Any) -> Iterator[int]:
    """Integers in nested lists."""
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
    write_json({"chunk": aligner.chunk, "prediction": PREDICTION}, folder / SETTINGS, VisionError)
