"""PhysAligner: fit a robot model to recordings."""

from embodiedreamer_gym.phys_aligner.calibration import METHODS, Calibration, calibrate
from embodiedreamer_gym.phys_aligner.problem import Problem

__all__ = ["METHODS", "Calibration", "Problem", "calibrate"]
