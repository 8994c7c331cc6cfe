"""The verb `vis camera`: lens and pose of a real camera from recordings of the robot before it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.files import read_json
from embodiedreamer_gym.recordings import Recording, load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.files import write_json

MARK = ("recording", "frame", "link", "point", "pixel")  # keys of a mark; "sd" may be added
LARGEST = 1e6  # m or pixels, of a number in a marks file
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")


def add_camera(actions: Any) -> None:
    """Add the action to those of `embodiedreamer vis`."""
    text = "lens and pose of a real camera from recordings of the robot before it"
    one = actions.add_parser("camera", help=text, description=text)
    one.add_argument("--model", required=True, metavar="M", help="JSON file, built-in robot, or a .urdf with --joints")
    one.add_argument("recordings", nargs="+", metavar="REC", help="files, folders, quoted globs")
    one.add_argument("--joints", metavar="A,B", help="names of the logs' columns, where the model is a .urdf")
    one.add_argument("--camera", metavar="NAME", help="of the recordings (default: their only one)")
    one.add_argument("--video", nargs="+", type=Path, metavar="FILE", help="of each recording, where it has no frames")
    one.add_argument("--masks", type=Path, metavar="DIR", help="of the robot: DIR/RECORDING/*.png, one per frame")
    one.add_argument("--start", type=Path, metavar="FILE.json", help="camera file with a first guess")
    one.add_argument("--marks", type=Path, metavar="FILE.json", help="points of the robot marked in frames")
    one.add_argument("--fixed", action="store_true", help="the camera stood in one place in all recordings")
    one.add_argument("--free", default="focal,aspect", metavar="A,B",
                     help="fitted of the lens: focal, aspect, cx, cy, k1, delay (default %(default)s)")  # fmt: skip
    one.add_argument("--loose", default="", metavar="A,B", help="links that look otherwise in the pictures")
    one.add_argument("--margin", type=float, default=0.06, metavar="M", help="m around them (default %(default)s)")
    one.add_argument("--rate", type=float, metavar="HZ", help="of logs without time stamps")
    one.add_argument("--seed", type=int, default=0, help="of the search (default 0)")
    one.add_argument("--out", type=Path, required=True, metavar="FILE.json", help="camera file")
    one.add_argument("--overlay", type=Path, metavar="DIR", help="pictures of the robot's outline over the frames")
    one.add_argument("--json", type=Path, metavar="FILE", help="write all that was found as JSON")
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.set_defaults(verb=_camera)


def _camera(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs.cameras import save_cameras  # PyBullet prints a line when it is loaded
    from embodiedreamer_gym.io.video import save_picture
    from embodiedreamer_gym.robot.surface import Surface
    from embodiedreamer_gym.vis_aligner.camera_calibration import calibrate_camera
    from embodiedreamer_gym.vis_aligner.camera_calibration.overlay import overlay

    _check_outputs(a)
    surface = _surface(a, Surface)
    logs = list(load_recordings(*a.recordings, hz=a.rate, joints=surface.joints))
    footage = _footage(a, logs, surface)
    marks = None if a.marks is None else _marks(a.marks, logs, surface, a.fixed)
    fit = calibrate_camera(
        surface.body, footage, start=_start(a.start), marks=marks, fixed=a.fixed, free=_listed(a.free),
        loose=_listed(a.loose), margin=a.margin, name=a.camera or "camera", seed=a.seed, report=progress,
    )  # fmt: skip
    progress.close()
    print(fit)
    save_cameras(fit.cameras, a.out)
    if a.json is not None:
        write_json(fit.as_dict(), a.json)
    if a.overlay is not None:
        a.overlay.mkdir(exist_ok=True)
        for k, one in enumerate(footage):
            view = fit.views()[0 if a.fixed else k]
            save_picture(overlay(surface.body, one, view, delay=fit.delay), a.overlay / f"{one.name}.png")
        print(f"\npictures: {a.overlay}; green must lie on the robot's edge")


def _surface(a: argparse.Namespace, surface: Any) -> Any:
    if not a.model.endswith(".urdf"):
        if a.joints:
            raise EmbodieDreamerError("--joints goes with a .urdf; a model names its joints itself.")
        return surface.of_model(RobotModel.load(a.model))
    if not a.joints:
        raise EmbodieDreamerError(f"{a.model} is a URDF; name the logs' columns with --joints a,b,c.")
    return surface(a.model, _listed(a.joints))


def _footage(a: argparse.Namespace, logs: Sequence[Recording], surface: Any) -> list[Any]:
    from embodiedreamer_gym.vis_aligner.camera_calibration import Footage
    from embodiedreamer_gym.vis_aligner.camera_calibration.video import VideoFrames

    if a.video is not None and len(a.video) != len(logs):
        raise EmbodieDreamerError(
            f"{len(a.video)} videos for {len(logs)} recordings; give one each, in the same order."
        )
    found = []
    for k, log in enumerate(logs):
        rows = len(log.time)
        frames = log.frames[_name(a.camera, log)] if a.video is None else VideoFrames(a.video[k], rows)
        masks = None if a.masks is None else _masks(a.masks, log.name, len(logs), rows)
        found.append(Footage(frames, surface.poses(log.position), masks, log.name))
    return found


def _name(asked: str | None, log: Recording) -> str:
    """Name of the camera whose frames are taken."""
    names = list(log.frames)
    if not names:
        raise VisionError(f"{log.name}: the recording has no frames; give --video FILE for each.")
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
            raise VisionError(f"mask {path} is no picture that can be read.")
    return [mask for mask in masks if mask is not None]


def _start(path: Path | None) -> Camera | None:
    if path is None:
        return None
    from embodiedreamer_gym.envs.cameras import load_cameras  # PyBullet prints a line when it is loaded

    cameras = load_cameras(path)
    if len(cameras) != 1:
        raise VisionError(f"{path} holds {len(cameras)} cameras ({', '.join(cameras)}); a first guess is one.")
    return next(iter(cameras.values()))


def _marks(path: Path, logs: Sequence[Recording], surface: Any, fixed: bool) -> Any:
    """Marks of a file {"marks": [{"recording": ..., "frame": ..., "link": ..., "point": [m], "pixel": [x, y]}]}."""
    from embodiedreamer_gym.vis_aligner.camera_calibration import Keypoints

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
            continue  # of another recording, which is not looked at now
        log = names.index(entry["recording"])
        if type(entry["frame"]) is not int or not 0 <= entry["frame"] < len(logs[log].time):
            raise VisionError(f"{where}: {names[log]} has no frame {json.dumps(entry['frame'])[:40]}.")
        place = _numbers(entry["point"], 3, f"{where}: point")
        if not isinstance(entry["link"], str):
            raise VisionError(f"{where}: link must be the name of a link, not {json.dumps(entry['link'])[:40]}.")
        point.append(surface.locate(entry["link"], place[None], logs[log].position[[entry["frame"]]])[0])
        pixel.append(_numbers(entry["pixel"], 2, f"{where}: pixel"))
        sd.append(_numbers([entry.get("sd", 1.0)], 1, f"{where}: sd")[0])
        stand.append(0 if fixed else log)
    if not stand:
        raise VisionError(f"marks {path} are of none of the recordings {', '.join(names)}.")
    return Keypoints(np.array(stand), np.array(point), np.array(pixel), np.array(sd))


def _numbers(value: Any, count: int, what: str) -> np.ndarray:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(x) in (int, float) and abs(x) <= LARGEST for x in value):
        raise VisionError(f"{what} must be {count} finite numbers, not {json.dumps(value)[:60]}.")
    return np.array(value, float)


def _listed(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _check_outputs(a: argparse.Namespace) -> None:
    """Complain about a seed or outputs that cannot be before the long work begins."""
    if a.seed < 0:
        raise EmbodieDreamerError(f"--seed is {a.seed}, but must be at least 0.")
    for path in filter(None, (a.out, a.json, a.overlay)):
        if not path.absolute().parent.is_dir():
            raise EmbodieDreamerError(f"{path} cannot be written: its folder does not exist; make it first.")
        if path.exists() and path.is_dir() != (path == a.overlay):
            raise EmbodieDreamerError(f"{path} cannot be written: it is {'a folder' if path.is_dir() else 'a file'}.")
