"""Robot models: URDF + servo + effects, with a JSON form, and the built-in robots."""

from embodiedreamer_gym.robot.files import built_in_robots
from embodiedreamer_gym.robot.model import RobotModel
from embodiedreamer_gym.robot.parameters import ParameterKey, ParameterRow, ParameterTable
from embodiedreamer_gym.robot.tree import KinematicTree

__all__ = ["KinematicTree", "ParameterKey", "ParameterRow", "ParameterTable", "RobotModel", "built_in_robots"]
