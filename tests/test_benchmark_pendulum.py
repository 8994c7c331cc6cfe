"""The benchmark's own pendulum against the package's: two simulations written apart agree."""

from __future__ import annotations

import numpy as np

from benchmarks.pendulum import GEARS, PARAMETERS, Pendulum
from embodiedreamer_gym.effects.load_friction import LoadFriction
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate

URDF = """<robot name="pendulum"><link name="base"/><joint name="joint1" type="revolute"><parent link="base"/>
<child link="arm"/><axis xyz="0 1 0"/><limit effort="5" lower="-3.2" upper="3.2" velocity="20"/></joint>
<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
<inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
VALUES = {"stiffness": 0.3, "damping": 0.06, "armature": 0.0025, "limit": 10.0, "motor": 0.25, "external": 0.15}


def test_it_moves_as_the_package_says(tmp_path) -> None:
    """Gear friction at two gains; without the friction it moves otherwise."""
    (tmp_path / "pendulum.urdf").write_text(URDF)
    (tmp_path / "pendulum.json").write_text('{"robot": {"urdf": "pendulum.urdf", "joints": ["joint1"]}}')
    model = RobotModel.load(tmp_path / "pendulum.json").with_(
        stiffness=np.array([VALUES["stiffness"]]), damping=np.array([VALUES["damping"]]),
        rotor_inertia=np.array([VALUES["armature"]]), viscous_friction=np.zeros(1),
    )  # fmt: skip
    gears = LoadFriction(coefficient={"joint1": VALUES["motor"]}, external={"joint1": VALUES["external"]})
    model = model.with_effect(gears)
    time = np.arange(800) / 200
    command = (1.5 * np.sin(2.0 * time) * np.sin(3.1 * time))[:, None]
    logs = []
    for gain in (1.0, 4.0):
        log = Recording("log", model.joints, time, command, command, gain=gain, command_hold="linear")
        log = log.with_(position=np.zeros_like(command))  # begins at rest where the pendulum hangs
        logs.append(log.with_(position=simulate(model, log).position))
    pendulum, off = (
        Pendulum.of(logs, tmp_path / "pendulum.urdf"),
        dict.fromkeys(PARAMETERS, 0.0) | {"stribeck_speed": 1.0},
    )
    assert pendulum.rms(off | VALUES) < 2e-3
    assert pendulum.rms(off | VALUES | {"motor": 0.0, "external": 0.0}) > 0.02
    assert set(VALUES) - {"external"} < set(GEARS)
