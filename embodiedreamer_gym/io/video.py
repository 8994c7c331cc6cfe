"""Write frames as a video file, and a picture as an image file."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.files import atomic_file


@renamed_arguments(rate="fps")
def write_video(frames: np.ndarray, path: str | Path, fps: float = 30.0) -> None:
    """Write frames (T, H, W, 3) uint8 as mp4 with OpenCV, which needs no optional dependency; fps: frames per second.

    LeRobot sets need h264 or AV1 with exact times: `recordings.episodes.video` writes these with PyAV.

    Raises: VisionError where the file cannot be written.
    """
    path = Path(path)
    wrong = VisionError(f"{path} cannot be written; give a file name.mp4 in a folder that exists.")
    if path.suffix != ".mp4" or not path.parent.is_dir():
        raise wrong
    height, width = frames.shape[1:3]
    with atomic_file(path, VisionError, suffix=".mp4") as part:
        writer = cv2.VideoWriter(str(part), cv2.VideoWriter.fourcc(*"mp4v"), fps, (width, height))
        if not writer.isOpened():
            raise wrong
        for frame in frames:
            writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
        writer.release()


def save_picture(picture: np.ndarray, path: str | Path) -> None:
    """Write a picture (h, w, 3), uint8 RGB, in the format of the path's suffix.

    Raises: VisionError when it cannot be written.
    """
    path = Path(path)
    try:
        good, data = cv2.imencode(path.suffix or ".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    except cv2.error as error:
        raise VisionError(f"{path} cannot be written: '{path.suffix}' is not an image format; use .png.") from error
    if not good:
        raise VisionError(f"{path} cannot be written: the picture cannot be encoded.")
    with atomic_file(path, VisionError) as part:
        part.write_bytes(data.tobytes())
