"""ACT, the action chunking transformer: network, training on episodes, checkpoints."""

from __future__ import annotations

from embodiedreamer_gym.io.deprecation import deprecated_names
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.ensemble import TemporalEnsemble
from embodiedreamer_gym.policies.act.network import Act
from embodiedreamer_gym.policies.act.object_pose_head import with_object_poses
from embodiedreamer_gym.policies.act.policy import ActPolicy
from embodiedreamer_gym.policies.act.samples import Samples, check_cameras, picture_size
from embodiedreamer_gym.policies.act.training import ActTraining, TrainingConfig, train

__all__ = [
    "Act",
    "ActConfig",
    "ActPolicy",
    "ActTraining",
    "Samples",
    "TemporalEnsemble",
    "TrainingConfig",
    "check_cameras",
    "picture_size",
    "train",
    "with_object_poses",
]

__getattr__ = deprecated_names(__name__, {"with_eyes": "with_object_poses", "Training": "ActTraining"})
