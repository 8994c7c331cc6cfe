"""The mujoco module, untyped, because its names come from compiled code that a type checker cannot read."""

from __future__ import annotations

import importlib
from typing import Any

mujoco: Any = importlib.import_module("mujoco")
