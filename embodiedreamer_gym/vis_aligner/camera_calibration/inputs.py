"""Inputs of a camera calibration: frames and masks of recordings, marked points, an initial guess."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import ModelError, VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.vis_aligner.camera_calibration import Footage, Keypoints
from embodiedreamer_gym.vis_aligner.camera_calibration.video import VideoFrames

MARK = ("recording", "frame", "link", "point", "pixel")  # keys of a mark; "sd" may be added
LARGEST = 1e6  # m or pixels, of a number in a marks file
GIVE_VIDEO = "; give --video FILE for each"
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")


def read_footage(
    logs: Sequence[Recording], surface: Any, camera: str | None = None, videos: Sequence[Path] | None = None,
    masks: Path | None = None,
) -> list[Footage]:  # fmt: skip
    """Frames, poses and masks of recordings.

    surface: of the robot; camera: name of the recordings' camera (None: their only one); videos: one for each
    recording, used instead of its frames; masks: a folder with one picture per frame, or with one such folder per
    recording.
    Raises: VisionError where a camera, a video or a mask is missing.
    """
    if videos is not None and len(videos) != len(logs):
        raise VisionError(f"{len(videos)} videos for {len(logs)} recordings; give one each, in the same order.")
    footage = []
    for k, log in enumerate(logs):
        rows = len(log.time)
        frames = log.frames[camera_name(camera, log, GIVE_VIDEO)] if videos is None else VideoFrames(videos[k], rows)
        pictures = None if masks is None else _masks(masks, log.name, len(logs), rows)
        footage.append(Footage(frames, surface.poses(log.position), pictures, log.name))
    return footage


def camera_name(asked: str | None, log: Recording, advice: str = "") -> str:
    """Name of the camera to use; asked: None for the only one; advice: for the error of a recording without frames.

    Raises: VisionError where the recording does not have it, or none is asked for and it has several.
    """
    names = list(log.frames)
    if not names:
        raise VisionError(f"{log.name}: the recording has no frames{advice}.")
    if asked is None and len(names) > 1:
        raise VisionError(f"{log.name}: choose one of its cameras with --camera: {', '.join(names)}.")
    if asked is not None and asked not in names:
        raise VisionError(f"{log.name}: there is no camera '{asked}'; it has {', '.join(names)}.")
    return asked or names[0]


def _masks(folder: Path, name: str, recordings: int, rows: int) -> list[np.ndarray]:
    """Masks of one recording, in the order of their names."""
    own = folder / name if (folder / name).is_dir() or recordings > 1 else folder
    paths = sorted(p for p in own.glob("*") if p.suffix.lower() in SUFFIXES)
    if len(paths) != rows:
        raise VisionError(f"{own} holds {len(paths)} masks, but {name} has {rows} frames; give one picture for each.")
    masks = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    for path, mask in zip(paths, masks, strict=True):
        if mask is None:
            raise VisionError(f"mask {path} is not a readable image.")
    return [mask for mask in masks if mask is not None]


def first_guess(cameras: Mapping[str, Camera], path: Path) -> Camera:
    """The only camera of a file.

    Raises: VisionError where there are several.
    """
    if len(cameras) != 1:
        raise VisionError(
            f"{path} holds {len(cameras)} cameras ({', '.join(cameras)}); a first guess needs exactly one."
        )
    return next(iter(cameras.values()))


def read_marks(path: Path, logs: Sequence[Recording], surface: Any, fixed: bool) -> Keypoints:
    """Marks of a file {"marks": [{"recording": ..., "frame": ..., "link": ..., "point": [m], "pixel": [x, y]}]}."""
    data = read_json(path, VisionError, "marks")
    entries = data.get("marks") if isinstance(data, dict) else None
    if not isinstance(entries, list) or not entries:
        raise VisionError(f'marks {path} must be {{"marks": [{{{", ".join(MARK)}, sd}}]}}.')
    names = [log.name for log in logs]
    stand, point, pixel, sd = [], [], [], []
    for k, entry in enumerate(entries):
        where = f"marks {path}, number {k}"
        if not isinstance(entry, dict) or any(key not in entry for key in MARK):
            raise VisionError(f"{where}: must have the keys {', '.join(MARK)}.")
        if entry["recording"] not in names:
            continue  # of a recording that is not used
        log = names.index(entry["recording"])
        if type(entry["frame"]) is not int or not 0 <= entry["frame"] < len(logs[log].time):
            raise VisionError(f"{where}: {names[log]} has no frame {json.dumps(entry['frame'])[:40]}.")
        if not isinstance(entry["link"], str):
            raise VisionError(f"{where}: link must be the name of a link, not {json.dumps(entry['link'])[:40]}.")
        place = _numbers(entry["point"], 3, f"{where}: point")
        try:
            point.append(surface.locate(entry["link"], place[None], logs[log].position[[entry["frame"]]])[0])
        except ModelError as error:
            raise VisionError(f"{where}: {error}") from error
        pixel.append(_numbers(entry["pixel"], 2, f"{where}: pixel"))
        sd.append(_numbers([entry.get("sd", 1.0)], 1, f"{where}: sd")[0])
        stand.append(0 if fixed else log)
    if not stand:
        raise VisionError(f"no mark in {path} belongs to one of the recordings {', '.join(names)}.")
    return Keypoints(np.array(stand), np.array(point), np.array(pixel), np.array(sd))


def _numbers(value: Any, count: int, what: str) -> np.ndarray:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(x) in (int, float) and abs(x) <= LARGEST for x in value):
        raise VisionError(f"{what} must be {count} finite numbers, not {json.dumps(value)[:60]}.")
    return np.array(value, float)
