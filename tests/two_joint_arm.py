"""A two-joint arm and recordings of it, made with the package's own simulation: their truth is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate

RATE = 100.0  # Hz
URDF = """<robot name="two">
 <link name="base"/>
 {links}
 <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
  <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="20"/></joint>
 <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
  <origin xyz="0.25 0 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="20"/></joint>
 <joint name="end" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.2 0 0"/></joint>
 <link name="tip"/>
</robot>
"""
LINK = """<link name="{name}"><inertial><origin xyz="{com} 0 0"/><mass value="{mass}"/>
  <inertia ixx="0.001" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link>"""


def write_arm(folder: Path, name: str = "two", **changes: object) -> Path:
    """Write the arm's URDF and model JSON; `changes` replace keys of the JSON. Returns the JSON's path."""
    links = [LINK.format(name="upper", com=0.12, mass=1.0, inertia=0.006)]
    links.append(LINK.format(name="fore", com=0.1, mass=0.6, inertia=0.003))
    (folder / "two.urdf").write_text(URDF.format(links="\n ".join(links)))
    model = {
        "robot": {"urdf": "two.urdf", "joints": ["shoulder", "elbow"], "end_effectors": ["tip"]},
        "servo": {"stiffness": [60.0, 25.0], "damping": [5.0, 1.5]},
        "rotor_inertia": [0.01, 0.005],
        "viscous_friction": [0.0, 0.0],
        "effects": [],
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(model | changes))
    return path


def load_arm(folder: Path) -> RobotModel:
    """The faultless arm."""
    return RobotModel.load(write_arm(folder))


def wave(seconds: float = 5.0, seed: int = 0) -> np.ndarray:
    """Command (T, 2) rad: three sines per joint after a second at rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1 / RATE)
    command = np.zeros((len(t), 2))
    for j in range(2):
        for frequency in rng.uniform(0.3, 1.4, 3):
            command[:, j] += 0.2 * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 6))
    return command * np.clip(t - 1.0, 0.0, 1.0)[:, None]


def record(
    model: RobotModel,
    name: str = "wave_1",
    noise: float = 0.0,
    command: np.ndarray | None = None,
    seed: int = 0,
    effort: bool = True,
) -> Recording:
    """What the model does, as a log that starts settled; noise: sd in rad; effort is twice the torque."""
    command = wave(seed=seed) if command is None else command
    rest = int(2 * RATE)
    command = np.concatenate([np.repeat(command[:1], rest, axis=0), command])
    time = np.arange(len(command)) / RATE
    quiet = {"noise": np.full(2, max(noise, 1e-5)), "quantum": np.zeros(2), "command_hold": "linear"}
    run = simulate(model, Recording(name, model.joints, time, command, command, **quiet))
    shown = slice(rest - int(0.5 * RATE), None)
    rng = np.random.default_rng(seed + 100)
    position = run.position[shown] + noise * rng.standard_normal(run.position[shown].shape)
    torque = 2.0 * run.torque[shown] if effort else None
    start = time[shown] - time[shown][0]
    return Recording(name, model.joints, start, position, command[shown], effort=torque, **quiet)
