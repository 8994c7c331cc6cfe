"""Surfaces as Blender's shader nodes, written as data: [type, settings, inputs], where ["@", node, output] is a link."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

Colour = tuple[float, float, float]
Link = list[Any]


@dataclass(frozen=True)
class Surface:
    """A material.

    pattern: a name in PATTERNS.
    colours: sRGB 0..1, as many as the pattern needs (the last is repeated).
    scale: size of the pattern's features, m.
    roughness, metallic, coat: 0..1, of Blender's Principled BSDF.
    bump: height of its relief, m.
    turn: rotation of the pattern about z, rad.
    """

    pattern: str
    colours: tuple[Colour, ...]
    scale: float = 0.1
    roughness: float = 0.5
    metallic: float = 0.0
    coat: float = 0.0
    bump: float = 0.0
    turn: float = 0.0


class Graph:
    """A list of shader nodes under construction."""

    def __init__(self, surface: Surface, shift: Sequence[float]) -> None:
        self.nodes: list[list[Any]] = []
        self.surface = surface
        coordinates = self.add("ShaderNodeTexCoord", output="Object")
        self.place = self.add("ShaderNodeMapping", {}, "Vector",
                              Vector=coordinates, Location=list(shift), Rotation=[0.0, 0.0, surface.turn])  # fmt: skip

    def add(self, kind: str, settings: dict[str, Any] | None = None, output: str | int = 0, **inputs: Any) -> Link:
        """Append a node; returns a link to one of its outputs. Numbered inputs are given as `_0`, `_1`, ...."""
        self.nodes.append([kind, settings or {}, {key.lstrip("_").replace("__", " "): value
                                                  for key, value in inputs.items()}])  # fmt: skip
        return ["@", len(self.nodes) - 1, output]

    def colour(self, index: int, share: float = 1.0) -> list[float]:
        """One of the surface's colours, linear, with alpha."""
        colours = self.surface.colours
        return [*(share * linear(c) for c in colours[min(index, len(colours) - 1)]), 1.0]

    def stretched(self, x: float, y: float, z: float) -> Link:
        """Coordinates in units of the pattern's scale, times factors."""
        scale = [factor / self.surface.scale for factor in (x, y, z)]
        return self.add("ShaderNodeMapping", {}, "Vector", Vector=self.place, Scale=scale)

    def noise(self, place: Link, scale: float = 1.0, detail: float = 4.0, distortion: float = 0.0) -> Link:
        """Smooth noise 0..1, around 0.5."""
        return self.add("ShaderNodeTexNoise", {}, 0, Vector=place, Scale=scale, Detail=detail, Distortion=distortion)

    def ramp(self, value: Link, *stops: Any) -> Link:
        """A colour as a function of a value 0..1."""
        return self.add("ShaderNodeValToRGB", {"ramp": [s if isinstance(s, str) else [s[0], s[1][:3]] for s in stops]},
                        "Color", Fac=value)  # fmt: skip

    def mix(self, share: Link | float, one: Any, other: Any, blend: str = "MIX") -> Link:
        """Two colours mixed; Blender's colour mixing node has its inputs at 0, 6, 7 and its output at 2."""
        settings = {"data_type": "RGBA", "blend_type": blend}
        return self.add("ShaderNodeMix", settings, 2, _0=share, _6=one, _7=other)

    def scaled(self, value: Link, factor: float, plus: float) -> Link:
        """A value times a factor plus a constant."""
        return self.add("ShaderNodeMath", {"operation": "MULTIPLY_ADD"}, 0, _0=value, _1=factor, _2=plus)


Pattern = Callable[[Graph], tuple[Link, Link | None]]  # colour, relief


def plain(g: Graph) -> tuple[Link, Link | None]:
    """One colour, slightly uneven."""
    cloudy = g.noise(g.stretched(1, 1, 1), detail=3.0)
    return g.ramp(cloudy, (0.3, g.colour(0, 0.92)), (0.7, g.colour(0, 1.04))), g.noise(g.stretched(40, 40, 40))


def wood(g: Graph) -> tuple[Link, Link | None]:
    """Veins along x in two colours, on staves of slightly different shades; scale: across the veins."""
    veins = g.noise(g.stretched(0.09, 1, 1), detail=4.0, distortion=0.8)
    rings = g.add("ShaderNodeTexWave", {"wave_type": "BANDS", "bands_direction": "Y"}, 0, Vector=g.stretched(0.05, 1, 1),
                  Scale=0.3, Distortion=14.0, Detail=2.0, Detail__Scale=0.5)  # fmt: skip
    broad = g.mix(0.2, veins, rings)
    staves = g.add("ShaderNodeTexBrick", {"offset": 0.41, "offset_frequency": 2}, "Color", Vector=g.stretched(1, 1, 1),
                   Color1=[0.86, 0.85, 0.84, 1.0], Color2=[1.0, 1.0, 1.0, 1.0], Mortar=[0.8, 0.78, 0.76, 1.0], Scale=1.0,
                   Mortar__Size=0.008, Brick__Width=14.0, Row__Height=1.6)  # fmt: skip
    grain = g.noise(g.stretched(0.4, 12, 12), detail=2.0)
    base = g.ramp(broad, (0.25, g.colour(0)), (0.75, g.colour(1)))
    streaks = g.ramp(grain, (0.3, [0.84, 0.82, 0.8]), (0.6, [1.0, 1.0, 1.0]))
    return g.mix(0.8, g.mix(0.7, base, streaks, "MULTIPLY"), staves, "MULTIPLY"), grain


def planks(g: Graph) -> tuple[Link, Link | None]:
    """Boards along x; scale: their width."""
    place = g.stretched(1, 1, 1)
    boards = g.add("ShaderNodeTexBrick", {"offset": 0.37, "offset_frequency": 2}, "Color", Vector=place,
                   Color1=g.colour(0), Color2=g.colour(1), Mortar=g.colour(0, 0.25), Scale=1.0, Mortar__Size=0.012,
                   Brick__Width=7.0, Row__Height=1.0)  # fmt: skip
    grain = g.noise(g.stretched(0.5, 9, 9), detail=5.0, distortion=0.5)
    streaks = g.ramp(grain, (0.3, [0.78, 0.76, 0.74]), (0.65, [1.0, 1.0, 1.0]))
    return g.mix(0.7, boards, streaks, "MULTIPLY"), grain


def tiles(g: Graph) -> tuple[Link, Link | None]:
    """Square tiles in two colours; the third is that of the joints."""
    square = g.add("ShaderNodeTexBrick", {"offset": 0.0}, "Color", Vector=g.stretched(1, 1, 1), Color1=g.colour(0),
                   Color2=g.colour(1), Mortar=g.colour(2), Scale=1.0, Mortar__Size=0.012, Mortar__Smooth=0.2,
                   Brick__Width=1.0, Row__Height=1.0)  # fmt: skip
    cloudy = g.ramp(g.noise(g.stretched(2, 2, 2), detail=6.0), (0.3, [0.86, 0.86, 0.86]), (0.7, [1.0, 1.0, 1.0]))
    return g.mix(1.0, square, cloudy, "MULTIPLY"), None


def speckle(g: Graph) -> tuple[Link, Link | None]:
    """Terrazzo: grains of the second and third colour on the first."""
    ground = g.noise(g.stretched(0.3, 0.3, 0.3), detail=2.0)
    base = g.ramp(ground, (0.3, g.colour(0, 0.94)), (0.7, g.colour(0, 1.03)))
    for index, (factor, share) in enumerate(((1.0, 0.23), (2.3, 0.3)), 1):
        cells = g.add("ShaderNodeTexVoronoi", {}, "Distance", Vector=g.stretched(factor, factor, factor), Scale=1.0)
        inside = g.ramp(cells, "constant", (0.0, [1.0] * 3), (share, [0.0] * 3))
        base = g.mix(inside, base, g.colour(index))
    return base, None


def cloth(g: Graph) -> tuple[Link, Link | None]:
    """Woven threads with large-scale unevenness; scale: the threads' width."""
    threads = [
        g.add("ShaderNodeTexWave", {"wave_type": "BANDS", "bands_direction": axis}, 0, Vector=g.stretched(1, 1, 1),
              Scale=0.16, Distortion=0.6, Detail=1.0) for axis in "XY"
    ]  # fmt: skip
    weave = g.mix(0.5, threads[0], threads[1], "MIX")
    large = g.noise(g.add("ShaderNodeMapping", {}, 0, Vector=g.place, Scale=[7.0] * 3), detail=4.0)
    colour = g.mix(weave, g.colour(0, 0.8), g.colour(1))
    folds = g.ramp(large, (0.3, [0.84] * 3), (0.7, [1.0] * 3))
    return g.mix(1.0, colour, folds, "MULTIPLY"), weave


def checks(g: Graph) -> tuple[Link, Link | None]:
    """A chequered cloth: stripes of the second colour crossing over the first."""
    colour: Any = g.colour(0)
    for axis in "XY":
        wave = g.add("ShaderNodeTexWave", {"wave_type": "BANDS", "bands_direction": axis, "wave_profile": "SIN"}, 0,
                     Vector=g.stretched(1, 1, 1), Scale=0.16, Distortion=0.05)  # fmt: skip
        colour = g.mix(g.ramp(wave, (0.49, [0.0] * 3), (0.51, [0.5] * 3)), colour, g.colour(1))
    fine = g.noise(g.add("ShaderNodeMapping", {}, 0, Vector=g.place, Scale=[400.0] * 3), detail=2.0)
    return g.mix(1.0, colour, g.ramp(fine, (0.3, [0.85] * 3), (0.7, [1.0] * 3)), "MULTIPLY"), fine


def concrete(g: Graph) -> tuple[Link, Link | None]:
    """Blotches of two colours and dark stains."""
    blotches = g.noise(g.stretched(1, 1, 1), detail=8.0, distortion=0.3)
    base = g.ramp(blotches, (0.32, g.colour(0)), (0.68, g.colour(1)))
    stains = g.ramp(g.noise(g.stretched(0.35, 0.35, 0.35), detail=5.0), (0.36, [0.72] * 3), (0.55, [1.0] * 3))
    return g.mix(0.8, base, stains, "MULTIPLY"), blotches


def carpet(g: Graph) -> tuple[Link, Link | None]:
    """Short fibres of two colours."""
    fibres = g.noise(g.stretched(1, 1, 1), detail=2.0)
    large = g.ramp(g.noise(g.stretched(0.02, 0.02, 0.02), detail=3.0), (0.3, [0.88] * 3), (0.7, [1.0] * 3))
    return g.mix(1.0, g.ramp(fibres, (0.38, g.colour(0)), (0.62, g.colour(1))), large, "MULTIPLY"), fibres


def bands(g: Graph) -> tuple[Link, Link | None]:
    """A print around an upright object: the second colour from 37 to 70 % of `scale`, the third as two lines."""
    height = g.add("ShaderNodeSeparateXYZ", {}, "Z", Vector=g.add("ShaderNodeTexCoord", output="Object"))
    share = g.scaled(height, 1.0 / g.surface.scale, 0.0)
    one, two, three = (g.colour(i) for i in range(3))
    stops = ((0.0, one), (0.30, three), (0.33, one), (0.37, two), (0.70, one), (0.74, three), (0.77, one))
    return g.ramp(share, "constant", *stops), None


def dots(g: Graph) -> tuple[Link, Link | None]:
    """Round spots of the second colour on the first."""
    cells = g.add("ShaderNodeTexVoronoi", {}, "Distance", Vector=g.stretched(1, 1, 1), Scale=1.0, Randomness=0.55)
    return g.ramp(cells, (0.30, g.colour(1)), (0.34, g.colour(0))), None


def brushed(g: Graph) -> tuple[Link, Link | None]:
    """Metal with fine lines along x."""
    lines = g.noise(g.stretched(0.05, 1, 1), detail=3.0)
    return g.ramp(lines, (0.3, g.colour(0, 0.85)), (0.7, g.colour(0, 1.05))), lines


PATTERNS: dict[str, Pattern] = {
    f.__name__: f for f in (plain, wood, planks, tiles, speckle, cloth, checks, concrete, carpet, bands, dots, brushed)
}


def nodes_of(surface: Surface, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> list[list[Any]]:
    """A surface's nodes, the shader last; shift: offset of the pattern (3,), m."""
    g = Graph(surface, shift)
    colour, relief = PATTERNS[surface.pattern](g)
    smudges = g.noise(g.add("ShaderNodeMapping", {}, 0, Vector=g.place, Scale=[9.0] * 3), detail=4.0)
    inputs: dict[str, Any] = {
        "Base__Color": colour, "Metallic": surface.metallic, "Coat__Weight": surface.coat,
        "Roughness": g.scaled(smudges, 0.24 * surface.roughness, 0.88 * surface.roughness),
    }  # fmt: skip
    if relief is not None and surface.bump > 0.0:
        inputs["Normal"] = g.add("ShaderNodeBump", {}, "Normal", Strength=1.0, Distance=surface.bump, Height=relief)
    g.add("ShaderNodeBsdfPrincipled", {}, 0, **inputs)
    return g.nodes


def linear(value: float) -> float:
    """Linear value of an sRGB value 0..1. Source: IEC 61966-2-1."""
    return float(value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4)
