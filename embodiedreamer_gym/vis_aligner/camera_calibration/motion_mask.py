"""Segmentation of the robot by background subtraction."""

from __future__ import annotations

import cv2
import numpy as np

GREY = 8.0  # levels of 255: standard deviation due to noise, compression and soft shadows
SHAKE = 1.0  # pixels by which a camera on a tripod may shake
CERTAIN = (1.0, 5.0)  # standard deviations from the background at which the foreground is 0, and 1
AROUND = 5  # pixels: the largest change in this square also counts as 1, so that edges do not spread outward
SOFT = 1.0  # pixels, standard deviation of the smoothing


def foreground_of_motion(frames: np.ndarray) -> np.ndarray:
    """Foreground score (T, H, W), 0..1, of frames (T, H, W, 3), uint8: confidence that something moving covers a pixel.

    The background is each pixel's median over the frames, which must differ from each other.
    """
    background = np.median(frames, axis=0).astype(np.float32)
    soft = cv2.GaussianBlur(background, (0, 0), 0.8)
    slopes = [cv2.Sobel(soft, cv2.CV_32F, *way, scale=1 / 8) for way in ((1, 0), (0, 1))]
    steep = np.max(np.hypot(*slopes), axis=2)
    sigma = np.hypot(GREY, SHAKE * steep)
    foreground = np.empty(frames.shape[:3], np.float32)
    square = np.ones((AROUND, AROUND), np.uint8)
    for t, frame in enumerate(frames):
        away = np.abs(frame.astype(np.float32) - background).max(axis=2) / sigma
        full = np.maximum(cv2.dilate(away, square), CERTAIN[1])
        foreground[t] = np.clip((away - CERTAIN[0]) / (full - CERTAIN[0]), 0.0, 1.0)
    return smooth(foreground)


def smooth(foreground: np.ndarray) -> np.ndarray:
    """Foreground (T, H, W), smoothed."""
    return np.stack([cv2.GaussianBlur(one.astype(np.float32), (0, 0), SOFT) for one in foreground])
