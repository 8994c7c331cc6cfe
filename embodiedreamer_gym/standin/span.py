"""Range of a stand-in robot's commands, from its URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.motions import Array, Span


def span_of(
    urdf: str | Path,
    joints: Sequence[str],
    centre: Array | None = None,
    reach: float = 0.7,
    speed: float = 0.8,
    normalised: Mapping[str, tuple[float, float]] | None = None,
) -> Span:
    """Return the range inside a URDF's limits: up to `reach` rad around `centre`, and `speed` times the speed limit.

    A normalised joint (URDF values at 0 and 1) gets its whole stroke, in 0..1.

    Raises: ModelError when a joint is missing or has no limits.
    """
    text = Path(urdf).read_text() if isinstance(urdf, Path) or not str(urdf).lstrip().startswith("<") else urdf
    limits = {j.get("name"): j.find("limit") for j in ElementTree.fromstring(text).iter("joint")}
    rows = []
    for i, name in enumerate(joints):
        limit = limits.get(name)
        if limit is None:
            raise ModelError(f"the URDF gives joint '{name}' no limits, so no motion can be made for it.")
        low, high, top = (float(limit.get(key, 0)) for key in ("lower", "upper", "velocity"))
        room = reach
        if normalised and name in normalised:
            low, high, top, room = 0.0, 1.0, 3.0, 0.5
        middle = (low + high) / 2 if centre is None else float(centre[i])
        rows.append((middle, min(room, middle - low, high - middle), speed * top))
    return Span(*np.array(rows).T)
