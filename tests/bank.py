"""What tests of the physics share: robots, effects of plain size, motions, energies and hidden-effect cases."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.effect import JointState
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel, built_in_robots
from embodiedreamer_gym.standin.arms import TRUTH, arm_joints, arm_urdf
from embodiedreamer_gym.standin.cases import Case, draw_case

BUILT_IN = built_in_robots()


@lru_cache
def robot(name: str) -> RobotModel:
    """A built-in robot, or a stand-in arm with its true servo."""
    if name in BUILT_IN:
        return RobotModel.load(name)
    servo = TRUTH[name]
    data = {
        "robot": {"urdf": f"{name}.urdf", "joints": list(arm_joints(name)), "end_effectors": ["tip"]},
        "servo": {"stiffness": list(servo.stiffness), "damping": list(servo.damping)},
        "rotor_inertia": list(servo.rotor_inertia),
        "viscous_friction": list(servo.viscous_friction),
    }
    return load(data, arm_urdf(name), name)


def load(data: dict[str, Any], urdf: str, name: str) -> RobotModel:
    """A model from its JSON and its URDF's text; its folder stays while the tests run, as PyBullet reads it later."""
    folder = Path(tempfile.mkdtemp(prefix="robot-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / f"{name}.urdf").write_text(urdf)
    path = folder / f"{name}.json"
    path.write_text(json.dumps(data))
    return RobotModel.load(path)


def plain(model: RobotModel, kind: type[Effect], share: float = 1.0) -> Effect:
    """The effect on all joints, this share of the way from off to a size that is plainly visible."""
    values = {}
    for p in kind.parameters:
        names = model.joints if p.per == "joint" else model.arms
        off, (low, high) = model.parameter_off(p), model.parameter_bounds(p)
        scale = high / p.high if p.high else low / p.low
        towards = np.clip(off + share * (p.typical * scale - off), low, high)
        values[p.name] = dict(zip(names, towards.tolist(), strict=True))
    return kind(**values)


def centre(model: RobotModel) -> np.ndarray:
    """The middle (n,) of the joints' ranges."""
    return np.where(np.isfinite(model.tree.lower), (model.tree.lower + model.tree.upper) / 2, 0.0)


def fast(model: RobotModel, seconds: float = 3.0, rate: float = 100.0, seed: int = 0, name: str = "fast_1"):
    """A log (of commands only: its positions are the commands) of fast sines about the middle of every range."""
    rng, n = np.random.default_rng(seed), model.n
    time = np.arange(int(seconds * rate) + 1) / rate
    reach = np.minimum(0.3, 0.3 * np.nan_to_num(model.tree.upper - model.tree.lower, posinf=1.0))
    wave = np.zeros((len(time), n))
    for _ in range(3):
        wave += np.sin(2 * np.pi * time[:, None] * rng.uniform(0.3, 2.5, n) + rng.uniform(0, 6.3, n)) / 2
    command = centre(model) + reach * wave * np.clip(2 * time, 0, 1)[:, None]
    return log(model, time, command, name=name)


def log(model: RobotModel, time, command, position=None, hold: str = "linear", name: str = "log_1") -> Recording:
    """Commands as a noise-free log that starts at its first position."""
    position = command if position is None else position
    sensor = {"noise": np.full(model.n, 1e-6), "quantum": np.zeros(model.n)}
    return Recording(name, model.joints, time, position, command, units=model.units, command_hold=hold, **sensor)


def still(model: RobotModel, pose: np.ndarray | None = None, seconds: float = 2.0) -> Recording:
    """A log in which the arm stands where its servo just carries its weight: nothing should move."""
    pose = centre(model) if pose is None else pose
    _, weight = model.bodies.mass_matrix_and_bias(pose[None], np.zeros((1, model.n)), model.nominal_mechanics)
    time = np.arange(int(seconds * 100) + 1) / 100
    command = np.tile(pose + weight[0] / model.stiffness, (len(time), 1))
    return log(model, time, command, position=np.tile(pose, (len(time), 1)))


def play(kind: Any, signal: np.ndarray, dt: float = 1 / 240, **values: float) -> np.ndarray:
    """What a signal law makes of a signal (k,), step by step, with these values."""
    p = SimpleNamespace(**{name: np.array([[value]]) for name, value in values.items()})
    memory = kind.start(np.array([[signal[0]]]), p, dt)
    out = []
    for k, value in enumerate(signal):
        joint = JointState(*(np.zeros((1, 1)) for _ in range(3)), dt, k * dt)
        changed, memory = kind.law(np.array([[value]]), joint, memory, p)
        out.append(changed[0, 0])
    return np.array(out)


def poses(model: RobotModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World rotation (k, 3, 3) and origin (k, 3) of every moving body at coordinates (n,)."""
    tree = model.tree
    rotation, origin = np.empty((tree.bodies, 3, 3)), np.empty((tree.bodies, 3))
    for i, up in enumerate(tree.parent):
        turn, move = (np.eye(3), np.zeros(3)) if up < 0 else (rotation[up], origin[up])
        rotation[i], origin[i] = turn @ tree.rotation[i], move + turn @ tree.origin[i]
        x = tree.gain[i] * q[tree.coordinate[i]] + tree.offset[i]
        if tree.prismatic[i]:
            origin[i] += x * rotation[i] @ tree.axis[i]
        else:
            cross = np.cross(np.eye(3), tree.axis[i])  # a x v as a matrix
            rotation[i] = rotation[i] @ (np.eye(3) + np.sin(x) * cross + (1 - np.cos(x)) * cross @ cross)
    return rotation, origin


def energy(model: RobotModel, q: np.ndarray, v: np.ndarray) -> float:
    """Kinetic and potential energy, J, at coordinates and speeds (n,); the rotors' too."""
    tree = model.tree
    matrix, _ = model.bodies.mass_matrix_and_bias(q[None], v[None], model.nominal_mechanics)
    rotation, origin = poses(model, q)
    height = tree.mass * origin[:, 2] + np.einsum("kij,kj->ki", rotation, tree.first_moment)[:, 2]
    return float(0.5 * v @ (matrix[0] + np.diag(model.rotor_inertia)) @ v + 9.81 * height.sum())


@lru_cache
def case(effect: str | None, arm: str, seed: int = 0, strength: str = "plain") -> tuple[Case, RobotModel]:
    """A stand-in robot with a hidden effect, and the nominal model a user starts from."""
    drawn = draw_case(effect, arm, np.random.default_rng(seed), strength)  # type: ignore[arg-type]
    return drawn, load(drawn.model_json, drawn.urdf, arm)
