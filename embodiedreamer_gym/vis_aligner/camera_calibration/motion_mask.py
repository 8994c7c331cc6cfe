"""What of a picture is the robot: it moves before a background that does not."""

from __future__ import annotations

import cv2
import numpy as np

GREY = 8.0  # levels of 255 that noise, compression and soft shadows come to
SHAKE = 1.0  # pixels by which a camera on a stand may waver
CERTAIN = (1.0, 5.0)  # standard deviations from the background at which a pixel begins to be, and surely is, the robot
AROUND = 5  # pixels: a stronger change within this square is what a full one is measured by, lest edges bleed outward
SOFT = 1.0  # pixels over which evidence is smoothed


def moving_evidence(frames: np.ndarray) -> np.ndarray:
    """How surely something moving covers each pixel (T, H, W), 0 .. 1, of frames (T, H, W, 3), uint8.

    The background is each pixel's median over the frames, which should therefore differ from each other.
    """
    background = np.median(frames, axis=0).astype(np.float32)
    soft = cv2.GaussianBlur(background, (0, 0), 0.8)
    slopes = [cv2.Sobel(soft, cv2.CV_32F, *way, scale=1 / 8) for way in ((1, 0), (0, 1))]
    steep = np.max(np.hypot(*slopes), axis=2)
    sigma = np.hypot(GREY, SHAKE * steep)
    found = np.empty(frames.shape[:3], np.float32)
    square = np.ones((AROUND, AROUND), np.uint8)
    for t, frame in enumerate(frames):
        away = np.abs(frame.astype(np.float32) - background).max(axis=2) / sigma
        full = np.maximum(cv2.dilate(away, square), CERTAIN[1])
        found[t] = np.clip((away - CERTAIN[0]) / (full - CERTAIN[0]), 0.0, 1.0)
    return smooth(found)


def smooth(evidence: np.ndarray) -> np.ndarray:
    """Evidence (T, H, W) without the jags of single pixels."""
    return np.stack([cv2.GaussianBlur(one.astype(np.float32), (0, 0), SOFT) for one in evidence])
