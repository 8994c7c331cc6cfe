"""Edit: masked areas of a picture, inpainted by a diffusion model from a local folder."""

from __future__ import annotations

import functools
import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.vis_aligner.editing.editor import Masks

CELL = 8  # pixels per side of the model's latents
STEPS = 30


@dataclass(frozen=True)
class Inpaint:
    """Inpaints table and background, or other masks, from a prompt, with diffusers' StableDiffusionInpaintPipeline.

    path: a folder that save_pretrained wrote; nothing is downloaded; names: of masks; edge: pixels of the picture's
    shorter side during inpainting; steps: of diffusion.
    """

    path: str | Path
    names: tuple[str, ...] = ("table", "background")
    edge: int = 512
    steps: int = STEPS

    def __call__(
        self, image: np.ndarray, masks: Masks, rng: np.random.Generator, prompt: str | None = None
    ) -> np.ndarray:
        """The picture (H, W, 3) uint8, inpainted inside the masks.

        Raises: VisionError without a prompt, for a name that the scene does not have, or a folder without such a model;
        MissingExtraError without diffusers or transformers.
        """
        if not prompt:
            raise VisionError("inpainting needs a prompt for the new content, such as 'a marble table'.")
        lacking = [name for name in self.names if name not in masks]
        if lacking:
            raise VisionError(f"the scene has no '{lacking[0]}' to inpaint; it has {', '.join(masks)}.")
        mask = np.any([masks[name] for name in self.names], axis=0)
        pipeline, seed = load_pipeline(str(self.path)), int(rng.integers(2**31))
        return np.where(mask[..., None], self._inpainted(pipeline, image, mask, seed, prompt), image)

    def draws(self, masks: Masks, rng: np.random.Generator) -> dict[str, Any]:
        """The seed of the noise."""
        return {"seed": int(rng.integers(2**31))}

    def _inpainted(self, pipeline: Any, image: np.ndarray, mask: np.ndarray, seed: int, prompt: str) -> np.ndarray:
        """The whole picture (H, W, 3) uint8 as the model generates it."""
        height, width = image.shape[:2]
        factor = self.edge / min(height, width)
        across, down = (max(CELL, round(side * factor / CELL) * CELL) for side in (width, height))
        large = cv2.resize(image, (across, down), interpolation=cv2.INTER_CUBIC)
        where = cv2.resize(mask.astype(np.uint8), (across, down), interpolation=cv2.INTER_NEAREST)
        with torch.inference_mode():
            made = pipeline(
                prompt=prompt, image=torch.from_numpy(large).permute(2, 0, 1)[None].float() / 255,
                mask_image=torch.from_numpy(where)[None, None].float(), height=down, width=across,
                num_inference_steps=self.steps, generator=torch.Generator().manual_seed(seed), output_type="np",
            ).images[0]  # fmt: skip
        small = cv2.resize(np.asarray(made, np.float32), (width, height), interpolation=cv2.INTER_AREA)
        return np.clip(np.round(small * 255), 0, 255).astype(np.uint8)


@functools.lru_cache(maxsize=1)
def load_pipeline(path: str) -> Any:
    """The pipeline from a folder.

    Raises: VisionError where the folder has none; MissingExtraError without diffusers or transformers.
    """
    if not Path(path).is_dir():
        raise VisionError(f"model folder {path} does not exist; give one that save_pretrained wrote.")
    try:
        importlib.import_module("transformers")
        diffusers: Any = importlib.import_module("diffusers")
        kind = diffusers.StableDiffusionInpaintPipeline
    except (ImportError, RuntimeError) as error:
        raise MissingExtraError(
            "inpainting needs diffusers and transformers; run: pip install 'embodiedreamer-gym[grounded,svd]'"
        ) from error
    try:
        pipeline = kind.from_pretrained(path, local_files_only=True, use_safetensors=True, safety_checker=None)
    except (OSError, ValueError, KeyError) as error:
        raise VisionError(f"{path} holds no inpainting pipeline: {str(error).splitlines()[0]}") from error
    pipeline.set_progress_bar_config(disable=True)
    return pipeline
