"""The start of an episode, from the options of a reset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from embodiedreamer_gym.envs import observations as observe
from embodiedreamer_gym.envs.arguments import check_choice, vector, within
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.envs.tasks.task import SIDES, Task, placed
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot import RobotModel

RESET_OPTIONS = ("joint_positions", "joint_velocities", "command", "object_poses")


def beginning(
    options: Mapping[str, Any], robot: RobotModel, task: Task, joint_space: spaces.Box
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Joint positions, joint velocities and command (14,) at the start of an episode; None to start at rest.

    Raises: SimulationError for an unknown option, or one of another shape or beyond what the joints can do.
    """
    for key in options:
        check_choice("reset option", key, RESET_OPTIONS)
    anywhere = {prop.name: Pose(np.zeros(3), np.zeros(4)) for prop in task.props}
    placed(SIDES[0], anywhere, options.get("object_poses"), task.object.name)  # before anything is drawn
    if not set(options) - {"object_poses"}:
        return None
    position = vector("joint_positions", options.get("joint_positions", home(robot)), robot.n)
    velocity = vector("joint_velocities", options.get("joint_velocities", np.zeros(robot.n)), robot.n)
    command = vector("command", options.get("command", position), robot.n)
    fastest = np.full(robot.n, observe.FASTEST)
    within("joint_positions", position, joint_space.low, joint_space.high)
    return position, within("joint_velocities", velocity, -fastest, fastest), command
