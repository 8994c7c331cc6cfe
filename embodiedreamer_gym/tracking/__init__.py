"""Commands from a calibrated model that bring the robot to its desired positions."""

from embodiedreamer_gym.tracking.feed_forward import FeedForward
from embodiedreamer_gym.tracking.tracker import MODES, Tracker
from embodiedreamer_gym.tracking.trajectory import Tracked, commands_for, joint_positions, track

__all__ = ["MODES", "FeedForward", "Tracked", "Tracker", "commands_for", "joint_positions", "track"]
