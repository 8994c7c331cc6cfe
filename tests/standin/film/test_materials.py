"""Surfaces as nodes: each feeds on earlier ones, and the last one shines."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.standin.film.materials import PATTERNS, Surface, linear, nodes_of

COLOURS = ((0.8, 0.1, 0.2), (0.1, 0.7, 0.3), (0.2, 0.3, 0.9))


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_pattern_is_a_whole_graph(pattern: str, count: int) -> None:
    nodes = nodes_of(Surface(pattern, COLOURS[:count], 0.05, 0.4, bump=1e-3, turn=0.3), (1.0, 2.0, 3.0))
    assert nodes == json.loads(json.dumps(nodes))
    used = set()
    for place, (kind, settings, inputs) in enumerate(nodes):
        assert kind.startswith("ShaderNode") and isinstance(settings, dict)
        for value in inputs.values():
            if isinstance(value, list) and value[0] == "@":
                assert 0 <= value[1] < place
                used.add(value[1])
    assert nodes[-1][0] == "ShaderNodeBsdfPrincipled" and nodes[-1][2]["Base Color"][0] == "@"
    assert used == set(range(len(nodes) - 1)) or nodes[-1][2].get("Normal") is None


def test_what_is_asked_for_is_in_the_nodes() -> None:
    plain, turned = (nodes_of(Surface("wood", COLOURS[:2], 0.05, 0.4, turn=t), (1.0, 2.0, 3.0)) for t in (0.0, 0.5))
    mapping = next(inputs for kind, _, inputs in turned if kind == "ShaderNodeMapping")
    assert mapping["Location"] == [1.0, 2.0, 3.0] and mapping["Rotation"] == [0.0, 0.0, 0.5]
    assert plain != turned
    shiny = nodes_of(Surface("plain", COLOURS[:1], metallic=0.7, coat=0.2, bump=1e-3))[-1][2]
    assert shiny["Metallic"] == 0.7 and shiny["Coat Weight"] == 0.2 and "Normal" in shiny
    assert "Normal" not in nodes_of(Surface("plain", COLOURS[:1]))[-1][2]


def test_colours_become_light() -> None:
    assert linear(0.0) == 0.0 and linear(1.0) == pytest.approx(1.0)
    assert linear(0.5) == pytest.approx(0.2140, abs=1e-4) and linear(0.04) == pytest.approx(0.04 / 12.92)
    ramp = next(s["ramp"] for _, s, _ in nodes_of(Surface("concrete", COLOURS[:2])) if "ramp" in s)
    np.testing.assert_allclose(ramp[0][1], [linear(c) for c in COLOURS[0]])
