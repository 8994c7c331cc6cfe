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

from embodiedreamer_gym.errors import MissingExtraError, SimulationError
from embodiedreamer_gym.geometry.camera import Camera

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
    studio = Studio(scene, python)
    try:
        studio.finish()
        for _ in scene["frames"]:
            yield studio.read()
    finally:
        studio.close()


class Studio:
    """Blender in a process of its own with a scene in it, of which it gives the frames' light, then that of others.

    Raises: MissingExtraError without bpy.
    """

    def __init__(self, scene: Mapping[str, Any], python: str | None = None) -> None:
        command = [check_blender(python), "-P", str(STUDIO)]
        self._size = int(scene["size"][0]), int(scene["size"][1])
        self._folder = tempfile.TemporaryDirectory()
        self._said = Path(self._folder.name) / "said"
        around = {**os.environ, "TMPDIR": self._folder.name, "OIDN_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        with self._said.open("w") as said:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, env=around
            )
        self._write(scene)

    def shoot(self, poses: np.ndarray) -> np.ndarray:
        """Light (H, W, 3) of the scene with its moving bodies at poses (bodies, 4, 4); after all of its own frames.

        Raises: SimulationError when Blender fails.
        """
        self._write(np.round(poses, 9).tolist())
        return self.read()

    def read(self) -> np.ndarray:
        """Light (H, W, 3) of the next frame that was asked for.

        Raises: SimulationError when Blender fails.
        """
        width, height = self._size
        data = self._process.stdout.read(16 * width * height) if self._process.stdout else b""
        if len(data) < 16 * width * height:
            last = (self._said.read_text(errors="replace").strip().splitlines() or ["it said nothing"])[-1]
            raise SimulationError(f"Blender has failed: {last}.")
        return np.flipud(np.frombuffer(data, np.float32).reshape(height, width, 4)[..., :3])

    def finish(self) -> None:
        """Tell it that no more frames will follow."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):  # it has failed, which its output will show
                self._process.stdin.close()

    def close(self) -> None:
        """End it; twice does no harm."""
        self._process.kill()  # in vain where it has ended by itself
        self._process.wait()
        self.finish()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._folder.cleanup()

    def _write(self, value: Any) -> None:
        """A line of JSON."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write(json.dumps(value).encode() + b"\n")
                self._process.stdin.flush()
