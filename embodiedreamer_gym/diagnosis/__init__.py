"""Diagnosis: where a model's error lies, and which physical effects it lacks."""

from embodiedreamer_gym.diagnosis.add_effect import Addition, add_effect
from embodiedreamer_gym.diagnosis.compare import compare
from embodiedreamer_gym.diagnosis.comparison import Comparison
from embodiedreamer_gym.diagnosis.diagnose import diagnose
from embodiedreamer_gym.diagnosis.diagnosis import Diagnosis
from embodiedreamer_gym.diagnosis.error_breakdown import ErrorBreakdown, error_breakdown
from embodiedreamer_gym.diagnosis.regimes import regimes
from embodiedreamer_gym.diagnosis.sessions import SessionComparison, compare_sessions

Where, where = ErrorBreakdown, error_breakdown  # former names

__all__ = [
    "Addition", "Comparison", "Diagnosis", "ErrorBreakdown", "SessionComparison", "Where", "add_effect", "compare",
    "compare_sessions", "diagnose", "error_breakdown", "regimes", "where",
]  # fmt: skip
