"""Diagnosis: where a model fails, and what it lacks."""

from embodiedreamer_gym.diagnosis.add_effect import Addition, add_effect
from embodiedreamer_gym.diagnosis.compare import Comparison, compare
from embodiedreamer_gym.diagnosis.diagnose import diagnose
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis
from embodiedreamer_gym.diagnosis.error_breakdown import Where, where
from embodiedreamer_gym.diagnosis.regimes import regimes

__all__ = [
    "Addition", "Comparison", "Diagnosis", "Where", "add_effect", "compare", "diagnose", "regimes", "where",
]  # fmt: skip
