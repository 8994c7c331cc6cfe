"""A two-joint arm with known values, and what its sensors would log."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate

JOINTS = ("shoulder", "elbow")
NOISE = 5e-4  # rad
LINK = (
    '<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
    '<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{x} 0 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="10"/></joint>'
)
URDF = "\n".join(
    [
        '<robot name="two">',
        LINK.format(name="base", x=0, mass=1, i=0.01),
        LINK.format(name="upper", x=0.15, mass=1.5, i=0.02),
        LINK.format(name="fore", x=0.1, mass=0.8, i=0.008),
        JOINT.format(name="shoulder", parent="base", child="upper", x=0),
        JOINT.format(name="elbow", parent="upper", child="fore", x=0.3),
        "</robot>",
    ]
)
TRUE = {"stiffness": (180.0, 60.0), "damping": (9.0, 2.5), "torque": (0.9, 0.3)}


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm")
    (path / "two.urdf").write_text(URDF)
    data = {
        "robot": {"urdf": "two.urdf", "joints": list(JOINTS)},
        "servo": {"stiffness": list(TRUE["stiffness"]), "damping": list(TRUE["damping"])},
        "rotor_inertia": [0.02, 0.01],
        "effects": [{"name": "coulomb_friction", "torque": list(TRUE["torque"])}],
    }
    (path / "true.json").write_text(json.dumps(data))
    return path


@pytest.fixture(scope="session")
def truth(folder: Path) -> RobotModel:
    return RobotModel.load(folder / "true.json")


@pytest.fixture(scope="session")
def start(truth: RobotModel) -> RobotModel:
    """The truth with gains and friction that are clearly off."""
    friction = {"coulomb_friction.torque": {"shoulder": 0.5, "elbow": 0.5}}
    off = {"stiffness": {"shoulder": 100.0, "elbow": 110.0}, "damping": {"shoulder": 15.0, "elbow": 1.5}}
    return truth.with_values({**off, **friction})


Record = Callable[..., Recording]


@pytest.fixture(scope="session")
def record(truth: RobotModel) -> Record:
    """Logs of the truth from rest: `record(seed, noise=, rate=, rule=, declared=, seconds=)`."""

    def play(seed, noise=NOISE, rate=50.0, rule="linear", declared="linear", seconds=5.0, model=truth):
        rng = np.random.default_rng(seed)
        lead, n = round(1.5 * rate), len(JOINTS)
        time = np.arange(lead + round(seconds * rate) + 1) / rate - 1.5
        command = np.tile([-0.6, 0.8], (len(time), 1))
        for low, high, size in ((0.2, 0.6, 0.35), (0.7, 1.5, 0.12), (1.5, 2.5, 0.05)):
            waves = 2 * np.pi * rng.uniform(low, high, n) * time[:, None] + rng.uniform(0, 2 * np.pi, n)
            command += size * np.sin(waves) * np.clip(time[:, None] / 0.5, 0, 1)
        known = {"noise": np.full(n, NOISE), "quantum": np.zeros(n)}
        blank = Recording("motion", JOINTS, time, command, command, command_hold=rule, **known)
        position = simulate(model, blank).position[lead:]
        position = position + noise if np.ndim(noise) else position + noise * rng.standard_normal(position.shape)
        name = f"motion-{seed}"
        return Recording(name, JOINTS, time[lead:], position, command[lead:], command_hold=declared, **known)

    return play
