"""The fixed appearance named "lab"."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.standin.film.appearance import Appearance, Block, Lamp
from embodiedreamer_gym.standin.film.camera_noise import CameraNoise
from embodiedreamer_gym.standin.film.materials import Surface


def lab() -> Appearance:
    """The fixed workspace."""
    surfaces = {
        "table": Surface("wood", ((0.7, 0.53, 0.37), (0.79, 0.63, 0.46)), 0.05, 0.42, coat=0.1, turn=np.pi / 2),
        "floor": Surface("concrete", ((0.42, 0.43, 0.44), (0.56, 0.56, 0.55)), 0.8, 0.55),
        "wall": Surface("plain", ((0.80, 0.79, 0.76),), 0.5, 0.9, bump=0.0004),
        "skirting": Surface("plain", ((0.32, 0.33, 0.35),), 0.3, 0.5),
        "deck": Surface("plain", ((0.13, 0.135, 0.145),), 0.2, 0.5, bump=0.0002),
        "legs": Surface("plain", ((0.55, 0.55, 0.56),), 0.3, 0.4, metallic=0.6),
        "shell": Surface("plain", ((0.83, 0.84, 0.84),), 0.15, 0.38, coat=0.2),
        "housing": Surface("plain", ((0.09, 0.09, 0.1),), 0.1, 0.42),
        "accent": Surface("brushed", ((0.52, 0.54, 0.57),), 0.02, 0.4, metallic=0.75),
        "pad": Surface("plain", ((0.05, 0.05, 0.055),), 0.05, 0.75),
        "cup": Surface("bands", ((0.93, 0.92, 0.89), (0.16, 0.5, 0.38), (0.16, 0.5, 0.38)), 0.085, 0.6),
        "mat": Surface("cloth", ((0.17, 0.25, 0.38), (0.23, 0.32, 0.45)), 0.003, 0.95, bump=0.0004),
        "pen": Surface("plain", ((0.9, 0.9, 0.88),), 0.1, 0.3),
        "pen2": Surface("plain", ((0.75, 0.1, 0.1),), 0.1, 0.25, coat=0.3),
        "holder": Surface("plain", ((0.3, 0.42, 0.36),), 0.1, 0.3, coat=0.5),
        "remote": Surface("plain", ((0.1, 0.1, 0.11),), 0.1, 0.45),
        "remote2": Surface("plain", ((0.8, 0.12, 0.1),), 0.1, 0.5),
        "remote3": Surface("plain", ((0.72, 0.72, 0.72),), 0.1, 0.6),
        "box": Surface("plain", ((0.66, 0.5, 0.34),), 0.06, 0.85, bump=0.0003),
        "carton": Surface("plain", ((0.62, 0.47, 0.32),), 0.1, 0.85),
        "crate": Surface("plain", ((0.2, 0.3, 0.42),), 0.2, 0.5),
    }  # fmt: skip
    blocks = (
        Block((1.62, -0.5, 0.14), (0.36, 0.5, 0.28), 0.25, "crate"),
        Block((1.5, -0.98, 0.2), (0.42, 0.34, 0.4), -0.35, "carton"),
    )
    lamps = (
        Lamp((0.75, 0.8, 2.4), (0.6, 0.1, 0.7), (0.6, 0.25), 46.0, (1.0, 0.95, 0.88)),
        Lamp((0.1, -0.9, 2.6), (0.6, -0.1, 0.7), (1.2, 0.3), 10.0, (1.0, 0.95, 0.88)),
        Lamp((0.9, 3.0, 1.6), (0.6, 0.0, 0.7), (1.2, 1.0), 70.0, (0.82, 0.9, 1.0)),
    )
    noise = CameraNoise(barrel=-0.02, vignette=0.24, blur=0.9, key=0.52, white=(1.02, 1.06), contrast=1.12, haze=0.01)
    return Appearance("lab", 7, surfaces, lamps, ((0.9, 0.95, 1.0), 0.12), 2.25, 0.0, blocks, noise)
