"""Masks of objects from text prompts: a detector finds the box, a segmenter the mask; both are in local folders.

Source: Ren et al., Grounded SAM, 2024; the models are Grounding DINO and SAM of transformers, or similar ones.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from embodiedreamer_gym.errors import MissingExtraError, VisionError
from embodiedreamer_gym.learning.device import find_device
from embodiedreamer_gym.vis_aligner.masks import MaskSource, checked


def grounded(detector: str | Path, segmenter: str | Path, prompts: Mapping[int, str], least: float = 0.3,
             device: str = "cpu") -> MaskSource:  # fmt: skip
    """Masks of the objects in the prompts, e.g. {3: "red cup", 4: "blue mat"}; an object that is not found has no mask.

    detector, segmenter: folders with model and processor, written by `save_pretrained` of transformers; nothing is
    downloaded; least: smallest score of a box, 0 .. 1; device: of both models, as in `load_aligner`.
    Raises: VisionError where a folder holds no such model, or the device is not available; MissingExtraError without
    transformers.
    """
    where = find_device(device, VisionError)
    find, find_inputs = _load(detector, "AutoModelForZeroShotObjectDetection", where)
    cut, cut_inputs = _load(segmenter, "AutoModelForMaskGeneration", where)

    def classes(frame: np.ndarray, number: int) -> np.ndarray:
        out = np.zeros(frame.shape[:2], np.uint8)
        for value, prompt in sorted(prompts.items(), reverse=True):  # the object is in front of its goal
            box = _box(find, find_inputs, frame, prompt, least)
            if box is not None:
                out[_outline(cut, cut_inputs, frame, box)] = value
        return checked(out, frame, f"mask of frame {number}")

    return classes


def _load(folder: str | Path, kind: str, device: torch.device) -> tuple[Any, Any]:
    """Model, on a device, and processor from a folder."""
    if not Path(folder).is_dir():
        raise VisionError(f"model folder {folder} does not exist; give one that save_pretrained wrote.")
    try:
        transformers: Any = importlib.import_module("transformers")
    except ImportError as error:
        raise MissingExtraError(
            "masks from words need transformers; run: pip install 'embodiedreamer-gym[grounded]'"
        ) from error
    try:
        model = getattr(transformers, kind).from_pretrained(str(folder), local_files_only=True, use_safetensors=True)
        return model.eval().to(device), transformers.AutoProcessor.from_pretrained(str(folder), local_files_only=True)
    except (OSError, ValueError, KeyError) as error:
        raise VisionError(f"{folder} holds no such model: {str(error).splitlines()[0]}") from error


def _box(model: Any, processor: Any, frame: np.ndarray, prompt: str, least: float) -> list[float] | None:
    """The best box (left, top, right, bottom), pixels, or None."""
    inputs = processor(images=frame, text=[[prompt]], return_tensors="pt").to(model.device)
    with torch.inference_mode():
        out = model(**inputs)
    detections = processor.post_process_grounded_object_detection(
        out, inputs["input_ids"], threshold=least, text_threshold=0.0, target_sizes=[frame.shape[:2]]
    )[0]
    return detections["boxes"][int(detections["scores"].argmax())].tolist() if len(detections["scores"]) else None


def _outline(model: Any, processor: Any, frame: np.ndarray, box: list[float]) -> np.ndarray:
    """The mask (H, W) bool of the object in a box."""
    inputs = processor(images=frame, input_boxes=[[box]], return_tensors="pt").to(model.device)
    with torch.inference_mode():
        out = model(**inputs, multimask_output=False)
    masks = processor.post_process_masks(out.pred_masks, inputs["original_sizes"], inputs["reshaped_input_sizes"])
    return masks[0][0, 0].cpu().numpy().astype(bool)
