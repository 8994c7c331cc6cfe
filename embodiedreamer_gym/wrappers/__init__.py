"""Wrappers around the environments."""

from __future__ import annotations

from embodiedreamer_gym.wrappers.flatten_cameras import FlattenCameras

__all__ = ["FlattenCameras"]
