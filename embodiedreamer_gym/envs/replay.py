"""Play a log's commands through an environment: policies are trained in the simulation that was calibrated."""

from __future__ import annotations

import gymnasium as gym
import numpy as np

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.simulation.rollout import check_names, command_rule, first_state


def replay(env: gym.Env, recording: Recording) -> np.ndarray:
    """Joint positions (T, 14) that the encoders read when an ALOHA environment plays a recording's commands.

    The environment starts at the recording's first state, with the props where its seed puts them; make it with
    `collisions=False` for a log of free motion. The recording's rate must be the environment's control rate.
    Raises: SimulationError when the robots or the rates differ.
    """
    aloha = env.unwrapped
    if not isinstance(aloha, AlohaEnv):
        raise SimulationError(f"{aloha} is not an ALOHA environment.")
    check_names(aloha.robot, recording)
    if abs(recording.hz - aloha.control_hz) > 0.01 * aloha.control_hz:
        raise SimulationError(
            f"recording {recording.name} runs at {recording.hz:.4g} Hz, the environment at {aloha.control_hz} Hz; "
            "make the environment with control_hz of the recording."
        )
    if (recording.gain != 1).any():
        raise SimulationError(
            f"recording {recording.name} was made with a different gain than that of the environment's servos; "
            "multiply the model's stiffness by this gain, and remove the gain from the recording."
        )
    command = np.asarray(recording.command, float)
    position, velocity = first_state(recording)
    aloha.reset(
        options={"joint_positions": position, "joint_velocities": velocity, "command": command[0]}
    )  # fmt: skip
    held = command_rule(aloha.robot, recording) == "hold"
    seen = [aloha.joint_positions()]
    for action in command[:-1] if held else command[1:]:
        aloha.step(action)
        seen.append(aloha.joint_positions())
    return np.array(seen)
