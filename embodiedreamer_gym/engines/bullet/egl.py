"""PyBullet's OpenGL renderer without a display: checks whether it can be loaded, and manages its contexts.

The plugin ends the process if it finds no driver, so another process tries it first. It also draws into the current
context: with two contexts in one process, each has to be made current before it is used.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import subprocess
import sys

from embodiedreamer_gym.engines.bullet.client import BulletClient
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.io.quiet import silenced

PACKAGES = "libegl1 libegl-mesa0 libgl1-mesa-dri"  # Debian's names
PLUGIN, ENTRY = "eglRenderer", "_eglRendererPlugin"  # a module of pybullet's wheel, suffix of its functions
TRIAL = f"import pybullet as p, sys; p.connect(p.DIRECT); sys.exit(p.loadPlugin(sys.argv[1], {ENTRY!r}) < 0)"
TRIAL_TIME = 60.0  # s
LARGEST = (1024, 768)  # pixels of its buffer; a larger picture would be upscaled from it
DRAW, READ = 0x3059, 0x305A  # EGL_DRAW, EGL_READ


def plugin_path() -> str | None:
    """Path of pybullet's plugin; None on a system without one."""
    found = importlib.util.find_spec(PLUGIN)
    return None if found is None else found.origin


@functools.cache
def is_available() -> bool:
    """Whether the plugin finds a driver, tested once in a separate process."""
    path = plugin_path()
    if path is None:
        return False
    try:
        trial = [sys.executable, "-c", TRIAL, path]
        return subprocess.run(trial, capture_output=True, timeout=TRIAL_TIME).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False


def fits(size: tuple[int, int]) -> bool:
    """Whether the plugin can draw a picture of a size (width, height)."""
    return size[0] <= LARGEST[0] and size[1] <= LARGEST[1]


class EglContext:
    """The plugin in one PyBullet world, which must not have bodies yet, as they would not be drawn.

    Raises: SimulationError when there are bodies, or the plugin cannot be loaded.
    """

    def __init__(self, client: BulletClient) -> None:
        if client.getNumBodies():
            raise SimulationError(
                f"the world holds {client.getNumBodies()} bodies that renderer 'egl' would not draw; "
                "make the renderer first, then load them."
            )
        self._client, self._plugin = client, -1
        path = plugin_path() if is_available() else None
        if path is not None:
            with silenced():
                self._plugin = client.loadPlugin(path, ENTRY)
        if self._plugin < 0:
            raise SimulationError(
                f"renderer 'egl' cannot be loaded here; install the Debian packages {PACKAGES}, or use 'tiny'."
            )
        self._egl = _library()
        self._handles = (
            self._egl.eglGetCurrentDisplay(), self._egl.eglGetCurrentSurface(DRAW),
            self._egl.eglGetCurrentSurface(READ), self._egl.eglGetCurrentContext(),
        )  # fmt: skip

    def make_current(self) -> None:
        """Make this context current in this thread.

        Raises: SimulationError when it is closed, or in use by another thread.
        """
        if self._plugin < 0:
            raise SimulationError("renderer 'egl' is closed; make a new one for a new world.")
        if not self._egl.eglMakeCurrent(*self._handles):
            raise SimulationError("renderer 'egl' is in use by another thread; make one environment for each thread.")

    def close(self) -> None:
        """Unload the plugin; safe to call twice."""
        if self._client.isConnected() and self._plugin >= 0:
            self.make_current()
            with silenced():
                self._client.unloadPlugin(self._plugin)
        self._plugin = -1


def _library() -> ctypes.CDLL:
    """The EGL library that the plugin has loaded."""
    egl = ctypes.CDLL("libEGL.so.1")
    for function in (egl.eglGetCurrentDisplay, egl.eglGetCurrentSurface, egl.eglGetCurrentContext):
        function.restype = ctypes.c_void_p
    egl.eglGetCurrentSurface.argtypes = [ctypes.c_int]
    egl.eglMakeCurrent.argtypes = [ctypes.c_void_p] * 4
    return egl
