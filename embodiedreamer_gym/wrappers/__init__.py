"""Wrappers around the environments."""

from __future__ import annotations

from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.calibrated_tracking import CalibratedTracking
from embodiedreamer_gym.wrappers.flatten_cameras import FlattenCameras
from embodiedreamer_gym.wrappers.perception_errors import PerceptionErrors, PerceptionErrorWrapper
from embodiedreamer_gym.wrappers.preference_rollout import PreferenceRolloutVectorWrapper, PreferenceRolloutWrapper
from embodiedreamer_gym.wrappers.vis_aligner import VisAlignerObservationWrapper, VisAlignerVectorWrapper

__all__ = [
    "ActionChunk",
    "CalibratedTracking",
    "FlattenCameras",
    "PerceptionErrorWrapper",
    "PerceptionErrors",
    "PreferenceRolloutVectorWrapper",
    "PreferenceRolloutWrapper",
    "VisAlignerObservationWrapper",
    "VisAlignerVectorWrapper",
]
