"""Key poses: learnt from demonstrations in the frames of the objects on the table, and joined by planned motions."""

from embodiedreamer_gym.policies.key_pose.policy import KeyPosePolicy
from embodiedreamer_gym.policies.key_pose.skill import Demonstration, Skill, learn

__all__ = ["Demonstration", "KeyPosePolicy", "Skill", "learn"]
