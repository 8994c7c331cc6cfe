"""Blender's path tracer in a separate process and Python interpreter: takes a scene, returns the light of each frame.

bpy is GPL-licensed and has wheels for Python 3.11 only, so it is never imported into this process.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
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
from embodiedreamer_gym.geometry.camera import Camera, rotation_matrix

STUDIO = Path(__file__).with_name("studio.py")
VARIABLE = "EMBODIEDREAMER_BLENDER"  # environment variable: path of a Python interpreter that has bpy
INSTALL = "pip install --no-deps 'bpy>=5.0.1,<6'"  # with its dependencies it would require numpy < 2
SENSOR = 36.0  # mm, width of the sensor of studio.py's camera
PROBE = "import importlib.util, sys; print(*sys.version_info[:2], importlib.util.find_spec('bpy') is not None)"


def find_blender(blender: str | None = None) -> str:
    """Path of a Python interpreter that has bpy.

    blender: its path; by default the current interpreter if it has bpy, else the path in the environment variable
    EMBODIEDREAMER_BLENDER.
    Raises: MissingExtraError with the command that installs bpy; SimulationError if the path is not a Python
    interpreter.
    """
    named = blender or ("" if importlib.util.find_spec("bpy") else os.environ.get(VARIABLE, ""))
    python = named or sys.executable
    version, has_bpy = _probe(python)
    if has_bpy:
        return python
    install = f"run: {python} -m {INSTALL}" if named else f"run: {INSTALL}"
    if version != "3.11":
        install = (f"it has wheels for Python 3.11 only, and {python} is {version}; make a virtual environment of Python "
                   f"3.11, run in it: {INSTALL}, and name it with --blender ENV/bin/python "
                   f"or {VARIABLE}=ENV/bin/python")  # fmt: skip
    raise MissingExtraError(f"the path-traced camera needs Blender's module bpy; {install}.")


@functools.lru_cache
def _probe(python: str) -> tuple[str, bool]:
    """Version of a Python interpreter, and whether it has bpy.

    Raises: SimulationError if the path is not a Python interpreter.
    """
    try:
        answer = subprocess.run([python, "-c", PROBE], capture_output=True, text=True, timeout=60, env=_environment())
        major, minor, has_bpy = answer.stdout.split()
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        raise SimulationError(f"{python} is not a Python interpreter; give the path of one that has bpy.") from error
    return f"{major}.{minor}", has_bpy == "True"


def _environment(**more: str) -> dict[str, str]:
    """This process's environment without variables that would make Blender's interpreter import this one's modules."""
    return {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME")} | more


def camera_spec(camera: Camera) -> dict[str, Any]:
    """Blender's description of a camera that is fixed in the world or to a moving body.

    Blender measures the offset of the principal point in picture widths (x right, y up), from pixel corners, and
    derives fy from fx by the pixels' aspect ratio, whose two numbers must be at least 1.
    """
    width, height = camera.size
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_matrix(camera.rotation) * (1.0, -1.0, -1.0), camera.position
    tall = camera.fx / camera.fy  # height of a pixel over its width
    return {
        "body": camera.link,
        "pose": pose.tolist(),
        "lens": SENSOR * camera.fx / width,
        "shift": [(0.5 * width - camera.cx - 0.5) / width, tall * (camera.cy + 0.5 - 0.5 * height) / width],
        "aspect": [max(1.0, 1.0 / tall), max(1.0, tall)],
        "near": camera.near,
        "far": 100.0,
    }


def render(scene: Mapping[str, Any], blender: str | None = None) -> Iterator[np.ndarray]:
    """Light (H, W, 3), float32, of each frame of a scene (see scene.py), one at a time.

    blender: see `find_blender`.
    Raises: MissingExtraError without bpy; SimulationError when Blender fails.
    """
    studio = Studio(scene, blender)
    try:
        studio.finish()
        for _ in scene["frames"]:
            yield studio.read()
    finally:
        studio.close()


class Studio:
    """A Blender process with a scene loaded; it renders the scene's own frames first, then further poses.

    blender: see `find_blender`.
    Raises: MissingExtraError without bpy.
    """

    def __init__(self, scene: Mapping[str, Any], blender: str | None = None) -> None:
        command = [find_blender(blender), "-P", str(STUDIO)]
        self._size = int(scene["size"][0]), int(scene["size"][1])
        self._folder = tempfile.TemporaryDirectory()
        self._log = Path(self._folder.name) / "stderr"
        environment = _environment(TMPDIR=self._folder.name, OIDN_NUM_THREADS="1", PYTHONWARNINGS="ignore")
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, env=environment
            )
        self._write(scene)

    def shoot(self, poses: np.ndarray) -> np.ndarray:
        """Light (H, W, 3) of the scene with its moving bodies at poses (bodies, 4, 4); call it after all own frames.

        Raises: SimulationError when Blender fails.
        """
        self._write(np.round(poses, 9).tolist())
        return self.read()

    def read(self) -> np.ndarray:
        """Light (H, W, 3) of the next requested frame.

        Raises: SimulationError when Blender fails.
        """
        width, height = self._size
        data = self._process.stdout.read(16 * width * height) if self._process.stdout else b""
        if len(data) < 16 * width * height:
            last = (self._log.read_text(errors="replace").strip().splitlines() or ["it printed nothing"])[-1]
            raise SimulationError(f"Blender has failed: {last}.")
        return np.flipud(np.frombuffer(data, np.float32).reshape(height, width, 4)[..., :3])

    def finish(self) -> None:
        """Close the process's input: no more poses will follow."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):  # the process has failed; `read` reports it
                self._process.stdin.close()

    def close(self) -> None:
        """End the process; safe to call twice."""
        self._process.kill()  # no effect if it has already ended
        self._process.wait()
        self.finish()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._folder.cleanup()

    def _write(self, value: Any) -> None:
        """Send one line of JSON."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write(json.dumps(value).encode() + b"\n")
                self._process.stdin.flush()
