"""Random robots as URDF text, with everything a real one has: fixed links, tilted frames, mimics, prismatic axes."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def random_urdf():
    """Make a URDF of a branching robot; returns its text and its driven joints."""

    def make(seed: int, moving: int = 7) -> tuple[str, list[str]]:
        rng = np.random.default_rng(seed)
        parts, joints, parents = ['<robot name="random">', '<link name="base"/>'], [], ["base"]
        for i in range(moving + 2):
            kind = "fixed" if i in (2, 5) else str(rng.choice(["revolute", "continuous", "prismatic"]))
            parts.append(f'<link name="link{i}">{_inertial(rng)}</link>')
            axis = rng.normal(size=3)
            mimic = ""
            if i == moving and kind != "fixed" and joints:
                mimic = f'<mimic joint="{joints[0]}" multiplier="-0.6" offset="0.1"/>'
            parts.append(
                f'<joint name="joint{i}" type="{kind}"><parent link="{rng.choice(parents[-3:])}"/>'
                f'<child link="link{i}"/><origin xyz="{_text(rng.normal(size=3) * 0.2)}" '
                f'rpy="{_text(rng.normal(size=3))}"/><axis xyz="{_text(axis / np.linalg.norm(axis))}"/>'
                f'<limit lower="-2" upper="2" effort="50" velocity="9"/>{mimic}</joint>'
            )
            parents.append(f"link{i}")
            if kind != "fixed" and not mimic:
                joints.append(f"joint{i}")
        return "\n".join([*parts, "</robot>"]), joints

    return make


def _inertial(rng: np.random.Generator) -> str:
    mass, size = rng.uniform(0.2, 3.0), rng.uniform(0.05, 0.3, 3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    box = mass / 12 * (np.sum(size**2) - size**2)
    inertia = turn @ np.diag(box) @ turn.T
    entries = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    named = " ".join(f'i{"xyz"[a]}{"xyz"[b]}="{float(inertia[a, b])!r}"' for a, b in entries)
    place = f'<origin xyz="{_text(rng.normal(size=3) * 0.1)}" rpy="{_text(rng.normal(size=3))}"/>'
    return f'<inertial>{place}<mass value="{mass}"/><inertia {named}/></inertial>'


def _text(values) -> str:
    return " ".join(repr(float(v)) for v in values)
