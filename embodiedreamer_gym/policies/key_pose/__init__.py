"""Key poses: learnt from demonstrations in the frames of the things on the table, with a planned way between them."""

from embodiedreamer_gym.policies.key_pose.policy import KeyPosePolicy
from embodiedreamer_gym.policies.key_pose.skill import Demonstration, Skill, learn

__all__ = ["Demonstration", "KeyPosePolicy", "Skill", "learn"]
