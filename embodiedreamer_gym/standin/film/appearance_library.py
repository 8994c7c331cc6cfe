"""Appearances by name: the lab, or a random table, robot, room and camera from a seed."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.standin.film.appearance import Appearance, Block, Lamp
from embodiedreamer_gym.standin.film.camera_noise import CameraNoise
from embodiedreamer_gym.standin.film.lab import lab
from embodiedreamer_gym.standin.film.materials import Colour, Surface

BLACK, DARK, GREY, WHITE = (0.07, 0.07, 0.075), (0.2, 0.2, 0.21), (0.55, 0.55, 0.56), (0.88, 0.88, 0.87)
OAK, WALNUT, BEECH, PINE = (
    ((0.62, 0.44, 0.28), (0.76, 0.6, 0.42)), ((0.29, 0.19, 0.13), (0.41, 0.28, 0.19)),
    ((0.78, 0.6, 0.44), (0.86, 0.71, 0.55)), ((0.8, 0.64, 0.42), (0.9, 0.77, 0.57)),
)  # fmt: skip
WOODS = (OAK, WALNUT, BEECH, PINE)
FURNITURE = [WHITE, GREY, DARK, (0.2, 0.3, 0.45), (0.62, 0.57, 0.48), (0.3, 0.42, 0.36), (0.5, 0.17, 0.14)]


def find_appearance(text: str, seed: int) -> Appearance:
    """The appearance of an episode: `lab`, `many` (random, from the episode's seed) or an integer (the seed itself).

    Raises: VisionError for anything else.
    """
    if text == "lab":
        return lab()
    if text == "many":
        return draw_appearance(seed)
    if text.isdecimal():
        return draw_appearance(int(text))
    raise VisionError(f"there is no appearance '{text}'; give lab, many, or a whole number that selects a random one.")


def draw_appearance(seed: int) -> Appearance:
    """Random materials, room, lights and camera; deterministic for a seed."""
    rng = np.random.default_rng([seed, 0xF11])
    table = _table(rng)
    surfaces = {"table": table, **_room(rng), **_robot(rng), **_props(rng, table.colours[0])}
    lamps, sky, white = _light(rng)
    noise = CameraNoise(
        barrel=-float(rng.uniform(0.0, 0.03)), vignette=float(rng.uniform(0.05, 0.4)),
        blur=float(rng.uniform(0.4, 1.6)), key=float(rng.uniform(0.45, 0.57)), white=white,
        contrast=float(rng.uniform(0.95, 1.35)), saturation=float(rng.uniform(0.8, 1.15)),
        haze=float(rng.uniform(0.0, 0.03)),
    )  # fmt: skip
    turn = float(rng.uniform(-0.25, 0.25))
    return Appearance(
        f"look {seed}", int(rng.integers(1 << 16)), surfaces, lamps, sky, float(rng.uniform(1.75, 3.4)), turn,
        _blocks(rng), noise,
    )  # fmt: skip


def _table(rng: np.random.Generator) -> Surface:
    """A table top: wood, laminate, terrazzo, metal or cloth."""
    kind = rng.choice(["wood", "planks", "plain", "speckle", "cloth", "checks", "brushed"],
                      p=[0.3, 0.1, 0.24, 0.12, 0.12, 0.05, 0.07])  # fmt: skip
    turn = float(rng.choice([0.0, np.pi / 2]) + rng.normal(0.0, 0.02))
    gloss = float(rng.uniform(0.22, 0.6))
    if kind in ("wood", "planks"):
        one, two = _shift(rng, WOODS[rng.integers(len(WOODS))], 0.05)
        scale = rng.uniform(0.03, 0.06) if kind == "wood" else rng.uniform(0.08, 0.15)
        return Surface(
            str(kind), (one, two), float(scale), gloss, coat=float(rng.uniform(0, 0.4)), bump=2e-4, turn=turn
        )
    if kind == "plain":
        colour = _choose(rng, [WHITE, GREY, DARK, (0.8, 0.76, 0.68), (0.45, 0.52, 0.5), (0.5, 0.56, 0.66)], 0.06)
        return Surface(
            "plain", (colour,), 0.3, gloss, coat=float(rng.uniform(0, 0.2)), bump=float(rng.choice([0, 1e-4]))
        )
    if kind == "speckle":
        ground = _choose(rng, [(0.74, 0.73, 0.7), (0.3, 0.31, 0.32), (0.62, 0.56, 0.5)], 0.06)
        grains = (_shade(ground, float(rng.uniform(-0.3, -0.12))), _shade(ground, float(rng.uniform(0.08, 0.25))))
        return Surface("speckle", (ground, *grains), float(rng.uniform(0.005, 0.012)), gloss, coat=0.2)
    if kind == "brushed":
        return Surface("brushed", (_choose(rng, [(0.6, 0.61, 0.63)], 0.06),), 0.01, 0.4, metallic=0.85, turn=turn)
    one = _hue(rng, (0.1, 0.5), (0.25, 0.75))
    two = WHITE if kind == "checks" else _shade(one, 0.1)
    scale = rng.uniform(0.04, 0.09) if kind == "checks" else rng.uniform(0.003, 0.007)
    return Surface(str(kind), (one, two), float(scale), 0.92, bump=5e-4, turn=turn)


def _room(rng: np.random.Generator) -> dict[str, Surface]:
    """Floor, wall, mount of the arms, and three kinds of boxes."""
    kind = str(rng.choice(["planks", "tiles", "concrete", "carpet", "speckle", "plain"]))
    cold, warm = _choose(rng, [(0.35, 0.36, 0.38), (0.55, 0.55, 0.54), (0.68, 0.67, 0.64)], 0.05), None
    if kind == "planks":
        cold, warm = _shift(rng, WOODS[rng.integers(len(WOODS))], 0.05)
    elif kind == "carpet":
        cold = _hue(rng, (0.03, 0.35), (0.2, 0.5))
    colours = (cold, warm or _shade(cold, 0.12), _shade(cold, -0.2))
    scale = {"planks": 0.14, "tiles": 0.4, "concrete": 0.8, "carpet": 0.012, "speckle": 0.02, "plain": 0.8}[kind]
    floor = Surface(kind, colours, scale * float(rng.uniform(0.8, 1.3)), float(rng.uniform(0.3, 0.75)),
                    turn=float(rng.uniform(0, np.pi / 2)))  # fmt: skip
    wall = _choose(rng, [WHITE, (0.82, 0.8, 0.74), (0.66, 0.7, 0.74), (0.6, 0.66, 0.6), (0.45, 0.47, 0.5)], 0.05)
    metal = float(rng.choice([0.0, 0.6]))
    surfaces = {
        "floor": floor,
        "wall": Surface(str(rng.choice(["plain", "concrete"])), (wall, _shade(wall, -0.04)), 0.5, 0.9, bump=4e-4),
        "skirting": Surface("plain", (_choose(rng, [WHITE, DARK, (0.45, 0.33, 0.22)], 0.05),), 0.3, 0.5),
        "deck": Surface("plain", (_choose(rng, [BLACK, DARK, GREY, (0.75, 0.75, 0.74)], 0.05),), 0.2, 0.5, metal),
        "legs": Surface("plain", (_choose(rng, [DARK, GREY, WHITE], 0.05),), 0.3, 0.4, metal),
    }
    for name in ("cabinet", "carton", "crate"):
        colour = (0.62, 0.47, 0.32) if name == "carton" else _choose(rng, FURNITURE, 0.06)
        surfaces[name] = Surface(
            "plain", (_shade(colour, float(rng.normal(0, 0.05))),), 0.3, float(rng.uniform(0.3, 0.85))
        )
    return surfaces


def _robot(rng: np.random.Generator) -> dict[str, Surface]:
    """Materials of the arms: white, black, silver or coloured shells, dark joints, metal."""
    shell = _choose(rng, [(0.85, 0.85, 0.85), (0.85, 0.85, 0.85), (0.12, 0.12, 0.13), (0.6, 0.61, 0.63)], 0.03)
    if rng.random() < 0.15:
        shell = _hue(rng, (0.5, 0.85), (0.45, 0.85))
    metal = float(rng.random() < 0.2) * 0.8
    dark = _choose(rng, [(0.08, 0.08, 0.09), (0.2, 0.2, 0.21), (0.3, 0.31, 0.33)], 0.03)
    if np.mean(shell) < 0.3:
        dark = _choose(rng, [(0.3, 0.31, 0.33), (0.5, 0.5, 0.51), (0.1, 0.1, 0.11)], 0.03)
    return {
        "shell": Surface("plain", (shell,), 0.15, float(rng.uniform(0.25, 0.55)), metal, float(rng.uniform(0, 0.4))),
        "housing": Surface("plain", (dark,), 0.1, float(rng.uniform(0.3, 0.6))),
        "accent": Surface("brushed", (_choose(rng, [(0.5, 0.52, 0.55), (0.2, 0.2, 0.22), (0.7, 0.7, 0.7)], 0.04),),
                          0.02, float(rng.uniform(0.3, 0.5)), float(rng.choice([0.0, 0.8]))),
        "pad": Surface("plain", (_choose(rng, [BLACK, BLACK, (0.25, 0.25, 0.26), (0.7, 0.35, 0.1)], 0.02),), 0.05, 0.75),
    }  # fmt: skip


def _props(rng: np.random.Generator, table: Colour) -> dict[str, Surface]:
    """Materials of the props; each colour differs from those of the table and of the prop's goal."""
    cup_kind = str(rng.choice(["plain", "bands", "dots"]))
    cup = _draw_distinct(lambda: WHITE if rng.random() < 0.35 else _hue(rng, (0.3, 0.7), (0.45, 0.85)), table)
    mat = _draw_distinct(lambda: _hue(rng, (0.1, 0.6), (0.2, 0.65)), table, cup)
    pen = _draw_distinct(lambda: _hue(rng, (0.0, 0.8), (0.1, 0.9)), table)
    holder = _draw_distinct(lambda: _hue(rng, (0.0, 0.6), (0.12, 0.75)), table, pen)
    remote = _draw_distinct(lambda: _choose(rng, [BLACK, (0.25, 0.25, 0.27), GREY, WHITE], 0.03), table)
    box = _draw_distinct(
        lambda: _choose(rng, [(0.66, 0.5, 0.34), WHITE, DARK, _hue(rng, (0.2, 0.55), (0.3, 0.65))], 0.05), table, remote
    )
    key = WHITE if np.mean(remote) < 0.5 else DARK
    gloss = lambda low, high: float(rng.uniform(low, high))  # noqa: E731
    return {
        "cup": Surface(cup_kind, (cup, _hue(rng, (0.3, 0.7), (0.3, 0.7)), WHITE), 0.02 if cup_kind == "dots" else 0.085,
                       gloss(0.3, 0.7)),
        "mat": Surface(str(rng.choice(["cloth", "plain", "carpet"])), (mat, _shade(mat, 0.07)), 0.003, 0.92, bump=4e-4),
        "pen": Surface("plain", (pen,), 0.1, gloss(0.2, 0.5)),
        "pen2": Surface("plain", (_draw_distinct(lambda: _hue(rng, (0.3, 0.95), (0.2, 0.9)), pen),), 0.1, gloss(0.2, 0.5), coat=0.3),
        "holder": Surface(str(rng.choice(["plain", "brushed", "wood"])), (holder, _shade(holder, 0.08)), 0.03,
                          gloss(0.2, 0.7), float(rng.choice([0.0, 0.0, 0.7]))),
        "remote": Surface("plain", (remote,), 0.1, gloss(0.25, 0.6)),
        "remote2": Surface("plain", (_hue(rng, (0.7, 0.9), (0.7, 0.9)),), 0.1, 0.5),
        "remote3": Surface("plain", (key,), 0.1, 0.6),
        "box": Surface(str(rng.choice(["plain", "wood"])), (box, _shade(box, 0.08)), 0.05, gloss(0.4, 0.9), bump=2e-4),
    }  # fmt: skip


def _light(rng: np.random.Generator) -> tuple[tuple[Lamp, ...], tuple[Colour, float], tuple[float, float]]:
    """Ceiling lamps, sometimes a window, the ambient light, and the camera's white balance."""
    warm = float(rng.uniform(0.0, 1.0))  # 0: daylight, 1: light bulbs
    bulb = (1.0, 1.0 - 0.16 * warm, 1.0 - 0.42 * warm)
    lamps = []
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(-0.6, 1.8), rng.uniform(-1.5, 1.5)
        size = (float(rng.uniform(0.25, 1.4)), float(rng.uniform(0.2, 0.6)))
        lamps.append(Lamp((float(x), float(y), float(rng.uniform(2.2, 3.0))), (float(0.6 + rng.normal(0, 0.2)), 0.0, 0.7),
                          size, float(rng.uniform(14, 50)), bulb))  # fmt: skip
    if rng.random() < 0.55:
        side = float(rng.choice([-1.0, 1.0]))
        day = (0.78 + 0.1 * float(rng.random()), 0.89, 1.0)
        lamps.append(Lamp((float(rng.uniform(0.2, 2.0)), side * float(rng.uniform(2.0, 3.2)), float(rng.uniform(1.3, 1.9))),
                          (0.6, 0.0, 0.7), (float(rng.uniform(0.8, 1.8)), float(rng.uniform(0.8, 1.5))),
                          float(rng.uniform(25, 160)), day))  # fmt: skip
    total = sum(lamp.power for lamp in lamps)
    mean = [sum(lamp.power * lamp.colour[i] for lamp in lamps) / total for i in range(3)]
    kept = float(rng.uniform(0.55, 1.0))  # share of the light's tint that the white balance removes
    white = tuple(float((mean[1] / mean[i]) ** kept * rng.normal(1.0, 0.03)) for i in (0, 2))
    return tuple(lamps), ((0.9, 0.95, 1.0), float(rng.uniform(0.1, 0.7))), (white[0], white[1])


def _blocks(rng: np.random.Generator) -> tuple[Block, ...]:
    """Boxes on the floor behind the table, lower than its top."""
    blocks = []
    for _ in range(int(rng.integers(1, 6))):
        x, y = float(rng.uniform(1.25, 2.2)), float(rng.uniform(-1.4, 1.4))
        size = (float(rng.uniform(0.2, 0.5)), float(rng.uniform(0.2, 0.7)), float(rng.uniform(0.15, 0.68)))
        name = str(rng.choice(["cabinet", "carton", "crate"]))
        blocks.append(Block((x, y, size[2] / 2), size, float(rng.uniform(-0.6, 0.6)), name))
    return tuple(blocks)


def _choose(rng: np.random.Generator, colours: list[Colour], spread: float) -> Colour:
    """One of several colours, randomly shifted."""
    return _shift(rng, (colours[int(rng.integers(len(colours)))],), spread)[0]


def _shift(rng: np.random.Generator, colours: tuple[Colour, ...], spread: float) -> tuple[Colour, ...]:
    """Colours, all shifted by the same random amount."""
    shade, tint = rng.normal(0.0, spread), rng.normal(0.0, 0.3 * spread, 3)
    return tuple(_clipped(np.array(colour) + shade + tint) for colour in colours)


def _hue(rng: np.random.Generator, saturation: tuple[float, float], value: tuple[float, float]) -> Colour:
    """A random hue, with saturation and value from ranges."""
    return _clipped(colorsys.hsv_to_rgb(rng.random(), rng.uniform(*saturation), rng.uniform(*value)))


def _shade(colour: Colour, by: float) -> Colour:
    return _clipped(np.array(colour) + by)


def _clipped(colour: Any) -> Colour:
    red, green, blue = np.clip(colour, 0.03, 0.93).tolist()
    return red, green, blue


def _draw_distinct(draw: Callable[[], Colour], *others: Colour) -> Colour:
    """The first of forty drawn colours that differs enough from others, or the most different one."""
    distance = lambda c: min(float(np.abs(np.subtract(c, other)).sum()) for other in others)  # noqa: E731
    drawn = [draw() for _ in range(40)]
    return next((colour for colour in drawn if distance(colour) > 0.75), max(drawn, key=distance))
