"""Replays recordings in plain MuJoCo from an exported file, and compares them with the package's own rollouts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from embodiedreamer_gym.engines.export.joints import scales
from embodiedreamer_gym.engines.export.report import Agreement
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.errors import ModelError, SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate_sets
from embodiedreamer_gym.simulation.drive import TIME_STEP
from embodiedreamer_gym.simulation.rollout import check_names, command_rule, first_state, plant_commands


def replay_mjcf(path: Path, model: RobotModel, recording: Recording, step: float = TIME_STEP) -> np.ndarray:
    """Joint positions (T, n), in recorded units, that MuJoCo alone simulates from a recording's commands.

    model: gives the unit of each joint, and how the controller interpolates commands; step: of the rollouts to compare
    with, s.
    Raises: ModelError when MuJoCo cannot read the file, SimulationError when it diverges.
    """
    check_names(model, recording)
    try:
        world = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read {path}: {error}.") from error
    data, dt = mujoco.MjData(world), world.opt.timestep
    _, gain, zero = scales(model)
    commands = gain * plant_commands(recording, command_rule(model, recording), dt) + zero
    joints = [world.joint(name) for name in model.joints]
    at, dof = (np.array([int(a[0]) for a in adr]) for adr in ([j.qposadr for j in joints], [j.dofadr for j in joints]))
    position, velocity = first_state(recording)
    rest(world, data, at, gain * position + zero, commands[0])
    data.qvel[dof] = gain * velocity
    for follower, leader, line in zip(world.eq_obj1id, world.eq_obj2id, world.eq_data, strict=True):
        data.qvel[world.jnt_dofadr[follower]] = line[1] * data.qvel[world.jnt_dofadr[leader]]
    mujoco.mj_forward(world, data)
    data.qvel += data.qacc * (step - dt) / 2  # in both simulations, a velocity is that of half a step earlier
    track = np.empty((len(commands), model.n))
    for k, command in enumerate(commands):
        data.ctrl[:], track[k] = command, data.qpos[at]
        mujoco.mj_step(world, data)
    if any(warning.number for warning in data.warning) or not np.isfinite(track).all():
        raise SimulationError(
            f"the replay of {recording.name} from {path} diverges in MuJoCo; choose a smaller time step."
        )
    spline = CubicSpline(np.arange(len(track)) * dt, (track - zero) / gain)
    return spline(recording.time - recording.time[0])


def rest(world: Any, data: Any, at: np.ndarray, position: np.ndarray, command: np.ndarray) -> None:
    """Place the joints at indices `at` (n,) and their followers, with the actuators at rest at a command (n,)."""
    data.qpos[at] = position
    for follower, leader, line in zip(world.eq_obj1id, world.eq_obj2id, world.eq_data, strict=True):
        one, other = world.jnt_qposadr[follower], world.jnt_qposadr[leader]
        data.qpos[one] = world.qpos0[one] + line[0] + line[1] * (data.qpos[other] - world.qpos0[other])
    data.ctrl[:] = command
    for i, value in enumerate(command):
        if world.actuator_actadr[i] >= 0:
            data.act[world.actuator_actadr[i]] = value
        if hasattr(world, "actuator_history") and world.actuator_history[i, 0] > 0:
            mujoco.mj_initCtrlHistory(world, data, i, None, np.full((int(world.actuator_history[i, 0]), 1), value))
    mujoco.mj_forward(world, data)
    for i in range(
        len(command), len(world.actuator_actadr)
    ):  # bristles carry the remaining torque at rest, up to their level
        if world.actuator_actadr[i] >= 0:
            left = data.qfrc_smooth[world.jnt_dofadr[world.actuator_trnid[i, 0]]]
            level, stiffness = world.actuator_biasprm[i, 4], world.actuator_dynprm[i, 5]
            data.act[world.actuator_actadr[i]] = np.clip(left, -level, level) / stiffness


def agreement(path: Path, model: RobotModel, recordings: Sequence[Recording], step: float = TIME_STEP) -> Agreement:
    """Differences between replays from a file and the model's rollouts at a step, s, by default that of `compare`.

    Raises: ModelError and SimulationError as in `replay_mjcf`.
    """
    runs = simulate_sets(model, recordings, dt=step)
    gaps = [
        np.abs(replay_mjcf(path, model, r, step) - run.at(0).position) for r, run in zip(recordings, runs, strict=True)
    ]
    largest, mean = (np.array([kind(gap, axis=0) for gap in gaps]) for kind in (np.max, np.mean))
    return Agreement(tuple(r.name for r in recordings), model.joints, largest, mean)
