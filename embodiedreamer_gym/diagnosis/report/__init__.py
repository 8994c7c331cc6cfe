"""The report of a comparison, a calibration or a diagnosis as one HTML page."""

from embodiedreamer_gym.diagnosis.report.page import write_report

__all__ = ["write_report"]
