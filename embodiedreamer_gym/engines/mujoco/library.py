"""MuJoCo's module, untyped: its names come from compiled code, which a type checker cannot read."""

from __future__ import annotations

import importlib
from typing import Any

mujoco: Any = importlib.import_module("mujoco")
