"""A renderer that takes no time, and Blender where it is installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.standin.film.blender import LINE

needs_bpy = pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None, reason=f"no Blender, which has wheels for Python 3.11 only: {LINE}"
)


def grey(scene: dict[str, Any]) -> Iterator[np.ndarray]:
    """Light of a scene in no time: a ramp, a little brighter in each frame."""
    width, height = scene["size"]
    ramp = np.linspace(0.1, 0.4, width, dtype=np.float32)[None, :, None]
    for number in range(len(scene["frames"])):
        yield np.broadcast_to(ramp * (1.0 + 0.01 * number), (height, width, 3))


def resized(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera whose own pictures have another size."""
    (fx, _, cx), (_, fy, cy), _ = camera.matrix(size).tolist()
    return camera.with_(size=size, fx=fx, fy=fy, cx=cx, cy=cy)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two masks (H, W)."""
    return float((one & other).sum() / (one | other).sum())


def fake_python(path: Path, answer: str, studio: str = "exit 1") -> str:
    """A program that answers like a Python asked for bpy, and does something else when it is to run the studio."""
    path.write_text(f'#!/bin/sh\nif [ "$1" = "-c" ]; then echo "{answer}"; else {studio}; fi\n')
    path.chmod(0o755)
    return str(path)
