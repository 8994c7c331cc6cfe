"""A renderer that takes no time, and Blender where it is installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.standin.film.blender import find_blender

try:
    find_blender()
    MISSING = ""
except EmbodieDreamerError as error:
    MISSING = str(error)
needs_bpy = pytest.mark.skipif(bool(MISSING), reason=MISSING)

STUDIO = """
import array, itertools, json, sys
if sys.argv[1] == "-c":
    print("3 11 True")
    sys.exit()
scene = json.loads(sys.stdin.readline())
for number, poses in enumerate(itertools.chain(scene["frames"], map(json.loads, iter(sys.stdin.readline, "")))):
    assert len(poses) == len(scene["moving"])
    width, height = scene["size"]
    row = [value for column in range(width) for value in [(0.1 + 0.3 * column / width) * (1 + 0.01 * number)] * 3 + [1.0]]
    sys.stdout.buffer.write(array.array("f", row * height).tobytes())
    sys.stdout.buffer.flush()
"""


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


def fake_blender(path: Path) -> str:
    """An interpreter that claims to have bpy and answers a scene with grey ramps, a little brighter in each frame."""
    path.write_text(f"#!{sys.executable}\n{STUDIO}")
    path.chmod(0o755)
    return str(path)
