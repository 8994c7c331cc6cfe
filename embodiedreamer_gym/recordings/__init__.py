"""Recordings of real and simulated robots: reading, writing, checking."""

from embodiedreamer_gym.recordings.arguments import as_recordings
from embodiedreamer_gym.recordings.checks import Finding
from embodiedreamer_gym.recordings.files import load_recordings, save_recording
from embodiedreamer_gym.recordings.frames import FrameSource
from embodiedreamer_gym.recordings.jitter import estimate_jitter, stamp_errors
from embodiedreamer_gym.recordings.noise import estimate_noise, estimate_quantum, noise_floor, sensor_sd
from embodiedreamer_gym.recordings.preflight import Preflight, preflight, preflight_all
from embodiedreamer_gym.recordings.recording import Recording, Recordings
from embodiedreamer_gym.recordings.segments import pieces, thin, window
from embodiedreamer_gym.recordings.smoothing import (
    Motion,
    smooth,
    smooth_derivatives,
    smooth_motion,
    smoothing_gain,
    smoothing_half,
    twice_smoothed_gain,
)

__all__ = [
    "Finding",
    "FrameSource",
    "Motion",
    "Preflight",
    "Recording",
    "Recordings",
    "as_recordings",
    "estimate_jitter",
    "estimate_noise",
    "estimate_quantum",
    "load_recordings",
    "noise_floor",
    "pieces",
    "preflight",
    "preflight_all",
    "save_recording",
    "sensor_sd",
    "smooth",
    "smooth_derivatives",
    "smooth_motion",
    "smoothing_gain",
    "smoothing_half",
    "stamp_errors",
    "thin",
    "twice_smoothed_gain",
    "window",
]
