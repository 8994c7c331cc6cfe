"""Blender's path tracer in a process of its own: a scene goes in, the light of each frame comes out."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.camera import Camera
from embodiedreamer_gym.errors import MissingExtraError, SimulationError

STUDIO = Path(__file__).with_name("studio.py")
LINE = "pip install --no-deps 'bpy>=5.0.1,<6'"  # with its dependencies it would ask for numpy < 2
SENSOR = 36.0  # mm, of studio.py's camera
ASK = "import importlib.util, sys; print(*sys.version_info[:2], importlib.util.find_spec('bpy') is not None)"


@functools.lru_cache
def check_blender(python: str | None = None) -> str:
    """Path of a Python that has bpy: the one asked for, or this one.

    Raises: MissingExtraError with the line that installs it; SimulationError for what is no Python.
    """
    found = python or sys.executable
    try:
        answer = subprocess.run([found, "-c", ASK], capture_output=True, text=True, timeout=60)
        major, minor, there = answer.stdout.split()
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        raise SimulationError(f"{found} is no Python; give the path of one that has bpy.") from error
    if there == "True":
        return found
    line = f"run: {found} -m {LINE}" if python else f"run: {LINE}"
    if (major, minor) != ("3", "11"):
        line = (f"it has wheels for Python 3.11 only, and {found} is {major}.{minor}; make a virtual environment "
                f"of Python 3.11, run in it: {LINE}, and name it with --blender ENV/bin/python")  # fmt: skip
    raise MissingExtraError(f"the path-traced camera needs Blender's module bpy; {line}.")


def camera_spec(camera: Camera) -> dict[str, Any]:
    """A camera standing in the world as Blender's.

    Blender counts the shift of the picture's middle from the axis in picture widths (x right, y up), pixels from the
    corner, and makes fy of fx by the pixels' aspect, whose two numbers must not be below 1.
    """
    width, height = camera.size
    position, rotation = camera.pose()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation * (1.0, -1.0, -1.0), position
    tall = camera.fx / camera.fy  # height of a pixel over its width
    return {
        "pose": pose.tolist(),
        "lens": SENSOR * camera.fx / width,
        "shift": [(0.5 * width - camera.cx - 0.5) / width, tall * (camera.cy + 0.5 - 0.5 * height) / width],
        "aspect": [max(1.0, 1.0 / tall), max(1.0, tall)],
        "near": camera.near,
        "far": 100.0,
    }


def render(scene: Mapping[str, Any], python: str | None = None) -> Iterator[np.ndarray]:
    """Light (H, W, 3) of each frame of a scene (see scene.py), float32, as it comes.

    Raises: MissingExtraError without bpy; SimulationError when Blender fails.
    """
    command = [check_blender(python), "-P", str(STUDIO)]
    width, height = scene["size"]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as said:
        around = {**os.environ, "TMPDIR": folder, "OIDN_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, env=around)
        try:
            _write(process, json.dumps(scene).encode())
            for _ in scene["frames"]:
                data = process.stdout.read(16 * width * height) if process.stdout else b""
                if len(data) < 16 * width * height:
                    said.seek(0)
                    last = (said.read().strip().splitlines() or ["it said nothing"])[-1]
                    raise SimulationError(f"Blender has failed: {last}.")
                yield np.flipud(np.frombuffer(data, np.float32).reshape(height, width, 4)[..., :3])
        finally:
            process.kill()  # in vain where it has ended by itself
            process.wait()
            if process.stdout is not None:
                process.stdout.close()


def _write(process: subprocess.Popen[bytes], text: bytes) -> None:
    if process.stdin is not None:
        with contextlib.suppress(BrokenPipeError):  # it has failed, which its output will show
            process.stdin.write(text)
            process.stdin.close()
