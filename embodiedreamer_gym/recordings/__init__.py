"""Recordings of real and simulated robots: reading, writing, checking."""

from embodiedreamer_gym.recordings.files import load_recordings, save_recording
from embodiedreamer_gym.recordings.frames import FrameSource
from embodiedreamer_gym.recordings.recording import Recording, Recordings

__all__ = ["FrameSource", "Recording", "Recordings", "load_recordings", "save_recording"]
