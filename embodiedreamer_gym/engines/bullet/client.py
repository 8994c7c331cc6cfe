"""A PyBullet world without a window."""

from __future__ import annotations

import os

import pybullet
from pybullet_utils.bullet_client import BulletClient


class World(BulletClient):
    """A world of its own in this process; the plain client prints a line when it connects."""

    def __init__(self) -> None:
        self._shapes: dict = {}
        self._pid = os.getpid()
        self._client = pybullet.connect(pybullet.DIRECT)
