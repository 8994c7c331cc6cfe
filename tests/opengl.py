"""MuJoCo's pictures need EGL or OSMesa, which a minimal system lacks."""

from __future__ import annotations

from functools import cache

import pytest

from embodiedreamer_gym.engines.mujoco.rendering import open_context
from embodiedreamer_gym.errors import SimulationError


@cache
def missing() -> str | None:
    """Why MuJoCo draws no pictures here, or None."""
    try:
        context, _ = open_context("auto", (32, 24))
    except SimulationError as error:
        return str(error)
    context.free()
    return None


def skip_without_pictures() -> None:
    """Skip a test that needs MuJoCo's pictures where there are none."""
    if missing() is not None:
        pytest.skip(str(missing()))
