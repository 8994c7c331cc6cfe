"""Diagnosis: where a model fails, and what it lacks."""

from embodiedreamer_gym.diagnosis.add import Addition, add_effect
from embodiedreamer_gym.diagnosis.compare import Comparison, compare
from embodiedreamer_gym.diagnosis.diagnose import diagnose
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis
from embodiedreamer_gym.diagnosis.regimes import regimes
from embodiedreamer_gym.diagnosis.where import Where, where

__all__ = [
    "Addition", "Comparison", "Diagnosis", "Where", "add_effect", "compare", "diagnose", "regimes", "where",
]  # fmt: skip
