"""The viser server under the page."""

from __future__ import annotations

import contextlib
import importlib
import io
import socket
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, MissingExtraError
from embodiedreamer_gym.robot.surface import Surface
from embodiedreamer_gym.workbench.guard import refusing_others

FIELD = 0.7  # rad; field of view of the initial camera
SIDE = np.array([1.9, -1.9, 1.1])  # initial camera position from the robot's middle, in robot sizes


def load_viser() -> Any:
    """Import viser.

    Raises: MissingExtraError with the command that installs it.
    """
    try:
        return importlib.import_module("viser")
    except ImportError as error:
        raise MissingExtraError(
            "the workbench needs viser, which is not installed; run: pip install 'embodiedreamer-gym[workbench]'"
        ) from error


def serve(host: str, port: int) -> Any:
    """A viser server that refuses other pages and offers no public tunnel; port 0: any free port.

    Raises: MissingExtraError without viser, EmbodieDreamerError where the address cannot be used.
    """
    viser = load_viser()
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
            probe.bind((host, 0))  # viser would search for a free port forever at an address that is not this machine's
            port = port or probe.getsockname()[1]
        with contextlib.redirect_stdout(io.StringIO()), refusing_others(host):
            server = viser.ViserServer(host=host, port=port, verbose=False)
    except OSError as error:
        raise EmbodieDreamerError(f"no page can be served at {host}:{port}: {error.strerror or error}.") from error
    messages = importlib.import_module("viser._messages")
    server._websock_server.unregister_handler(messages.ShareUrlRequest)
    server.scene.world_axes.visible = False
    return server


def place_camera(server: Any, surface: Surface, position: np.ndarray) -> None:
    """Place the initial camera beside a robot at joint position (n,), so that all of it is in view."""
    points = surface.points(position[None])[0]
    middle, size = 0.5 * (points.min(axis=0) + points.max(axis=0)), float(np.ptp(points, axis=0).max())
    camera = server.initial_camera
    camera.look_at, camera.position, camera.fov = tuple(middle), tuple(middle + size * SIDE), FIELD
    server.scene.configure_default_lights(cast_shadow=False)  # shadows are slow without a graphics card
