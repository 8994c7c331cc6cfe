"""The table of all tasks."""

from __future__ import annotations

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape

TABLE_HEIGHT = 0.74  # m
TABLE = Prop("table", (0.56, 1.3, TABLE_HEIGHT), 1.0, (0.82, 0.77, 0.69, 1.0),
             (Shape("box", (0.56, 1.3, 0.04), (0.0, 0.0, TABLE_HEIGHT - 0.02)),), fixed=True)  # fmt: skip
TABLE_CENTRE = (0.6, 0.0, 0.0)  # m; its edge is 8 cm in front of the arms' plates
