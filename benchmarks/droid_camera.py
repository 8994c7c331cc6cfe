"""Real Franka clips: camera calibration from hand-made marks, without marks, and with both.

python -m benchmarks.droid_camera [--data ../shared/data/droid_franka] [--camera 0 1] [--alone] [--overlay DIR] [--out FILE.json]
python -m benchmarks.droid_camera --standin FILE.hdf5 ...

Nine episodes filmed by two cameras with unpublished lenses and poses. The cameras were moved between episodes, so each
has one lens and nine poses. benchmarks/droid_points.json has marks made by hand; those with "fitted": false are never
used in a fit; errors are of these marks, in pixels of the 320 x 192 pictures. --alone finds the camera of each episode
from that episode alone. The gripper is not a Panda's: its links are declared loose, the only prior information given.
Data: github.com/Robert-gyj/Ctrl-World, commit 4c713d1, dataset_example/droid_new_setup (MIT), not shipped. Robot:
franka_panda of pybullet_data. --standin uses episodes of `embodiedreamer standin film` in place of the clips: their
true camera is known, and the error is given in pixels, mm and degrees.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pybullet_data
from scipy.spatial.transform import Rotation

from benchmarks.common import data_folder, save
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.surface import Surface
from embodiedreamer_gym.vis_aligner.camera_calibration import (
    CameraFit,
    Footage,
    Keypoints,
    View,
    calibrate_camera,
    fit_keypoints,
)
from embodiedreamer_gym.vis_aligner.camera_calibration.overlay import overlay
from embodiedreamer_gym.vis_aligner.camera_calibration.video import VideoFrames

POINTS = Path(__file__).with_name("droid_points.json")
JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))
LOOSE = ("panda_hand", "panda_leftfinger", "panda_rightfinger")  # real: a Robotiq gripper and a camera
EPISODES = ("0001", "0003", "0004", "0006", "0007", "0008", "0010", "0011", "0012")


def panda() -> Surface:
    """The Panda that PyBullet ships."""
    return Surface(Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf", JOINTS)


def footage(data: Path, episode: str, camera: int, surface: Surface) -> Footage:
    """One episode filmed by one camera."""
    angles = joint_angles(data, episode)
    frames = VideoFrames(data / "videos" / episode / f"{camera}.mp4", len(angles))
    return Footage(frames, surface.poses(angles), name=episode)


def joint_angles(data: Path, episode: str) -> np.ndarray:
    """Joint angles (T, 7), rad, of an episode."""
    rows = json.loads((data / "annotation" / f"{episode}.json").read_text())["joints"]
    return np.array(rows)[:, : len(JOINTS)]


def marks(data: Path, surface: Surface, camera: int, episodes: Sequence[str], fitted: bool | None) -> Keypoints:
    """Marks of one camera in some episodes; fitted: True for the marks to fit, False for the others, None for all."""
    entries = [
        entry
        for entry in json.loads(POINTS.read_text())["marks"]
        if entry["camera"] == camera and entry["recording"] in episodes and fitted in (None, entry["fitted"])
    ]
    angles = {episode: joint_angles(data, episode) for episode in episodes}
    points = [
        surface.locate(e["link"], np.array([e["point"]]), angles[e["recording"]][[e["frame"]]])[0] for e in entries
    ]
    return Keypoints(
        np.array([episodes.index(e["recording"]) for e in entries]), np.reshape(points, (-1, 3)),
        np.reshape([e["pixel"] for e in entries], (-1, 2)), np.array([e["sd"] for e in entries]),
    )  # fmt: skip


def marked(data: Path, surface: Surface, camera: int) -> tuple[str, ...]:
    """Episodes with four or more marks to fit."""
    return tuple(e for e in EPISODES if len(marks(data, surface, camera, (e,), True)) >= 4)


def row(way: str, camera: int, fit: CameraFit, unused: Keypoints, seconds: float) -> dict:
    """Print one line of the table and return its row."""
    errors = unused.errors(fit.views())
    lens = fit.cameras[0]
    found = {
        "camera": camera, "way": way, "stands": len(fit.stations), "unused": len(errors),
        "median": float(np.median(errors)), "p90": float(np.quantile(errors, 0.9)), "fx": lens.fx, "fy": lens.fy,
        "k1": fit.k1, "delay": fit.delay, "cpu_s": seconds, "doubtful": list(fit.doubtful), "fit": fit.as_dict(),
    }  # fmt: skip
    print(f"camera {camera}  {way:<22} {len(fit.stations)} places  {len(errors):3d} unused marks: median "
          f"{found['median']:.2f} px, 90 % within {found['p90']:.1f}  fx {lens.fx:.1f} fy {lens.fy:.1f}  "
          f"{seconds:.0f} s of CPU", flush=True)  # fmt: skip
    return found


def timed(calibrate, *given, **named) -> tuple[CameraFit, float]:
    begun = time.process_time()
    return calibrate(*given, **named), time.process_time() - begun


def one_camera(data: Path, surface: Surface, camera: int, free: tuple[str, ...]) -> tuple[list[dict], CameraFit]:
    """Fits of one camera: from marks, from marks and outlines, on all episodes from that fit, and without a guess."""
    few = marked(data, surface, camera)
    used, unused = (marks(data, surface, camera, few, fitted) for fitted in (True, False))
    print(f"camera {camera}: {len(used)} marks to fit, {len(unused)} unused, in the episodes {', '.join(few)}")
    fit, seconds = timed(fit_keypoints, used, (320, 192), free=("focal", "aspect"), names=few, name=f"camera{camera}")
    rows = [row("marks", camera, fit, unused, seconds)]
    takes = [footage(data, e, camera, surface) for e in EPISODES]
    given = {"loose": LOOSE, "name": f"camera{camera}", "free": free}
    chosen = [take for take in takes if take.name in few]
    fit, seconds = timed(calibrate_camera, surface.body, chosen, marks=used, **given)
    rows.append(row("marks and outlines", camera, fit, unused, seconds))
    start = fit.cameras[0]
    fit, seconds = timed(calibrate_camera, surface.body, takes, start=start, **given)
    rows.append(row("all from the first", camera, fit, marks(data, surface, camera, EPISODES, False), seconds))
    print(fit)
    try:
        fit, seconds = timed(calibrate_camera, surface.body, takes, **given)
    except VisionError as error:
        print(f"camera {camera}  nothing: {error}", flush=True)
        return rows, fit
    everything = marks(data, surface, camera, EPISODES, None)
    rows.append(row("nothing", camera, fit, marks(data, surface, camera, EPISODES, False), seconds))
    rows.append(row("nothing, all marks", camera, fit, everything, seconds))
    errors = everything.errors(fit.views())
    for k, episode in enumerate(EPISODES):
        own = errors[everything.station == k]
        print(f"    {episode}  {len(own):2d} marks  median {np.median(own):5.2f} px  largest {own.max():5.2f} px")
    print(fit)
    return rows, fit


def alone(data: Path, surface: Surface, camera: int, free: tuple[str, ...]) -> list[dict]:
    """Fit every episode by itself, without a guess."""
    rows = []
    for episode in EPISODES:
        take = footage(data, episode, camera, surface)
        fit, seconds = timed(calibrate_camera, surface.body, [take], loose=LOOSE, name=episode, free=free)
        rows.append(row(f"{episode} alone", camera, fit, marks(data, surface, camera, (episode,), None), seconds))
    return rows


def standin(paths: Sequence[Path], free: tuple[str, ...]) -> list[dict]:
    """Stand-in films: error of the camera found with or without a guess near the truth, from motion or masks."""
    import h5py

    surface, takes, angles = Surface.of_model(RobotModel.load("aloha")), [], []
    for path in paths:
        with h5py.File(path) as file:
            angles.append(np.asarray(file["observations/qpos"]))
            truth = Camera("true", **json.loads(str(file.attrs["camera"])))
            barrel = json.loads(str(file.attrs["look"]))["lens"]["barrel"]
            robot = np.asarray(file["observations/masks/head"]) == 2
            takes.append(
                Footage(np.asarray(file["observations/images/head"]), surface.poses(angles[-1]), robot, path.stem)
            )
    points = np.concatenate([surface.points(a[::5])[:, ::7] for a in angles]).reshape(-1, 3)
    wide, high = takes[0].size
    seen = View.from_camera(truth, takes[0].size, barrel).project(points)
    inside = (seen[:, 2] > 0) & (seen[:, 0] > 0) & (seen[:, 0] < wide) & (seen[:, 1] > 0) & (seen[:, 1] < high)
    guess = truth.with_(
        position=tuple(np.add(truth.position, (0.06, -0.06, 0.06)).tolist()), fx=truth.fx * 1.1, fy=truth.fy * 1.1,
        rotation=tuple((Rotation.from_quat(truth.rotation) * Rotation.from_rotvec([0.05, -0.05, 0.05])).as_quat()),
    )  # fmt: skip
    rows = []
    bare = [replace(take, masks=None) for take in takes]
    for way, shown in (
        ("the guess", None),
        ("guess, motion", bare),
        ("guess, masks", takes),
        ("nothing, masks", takes),
    ):
        begun, camera, view = time.process_time(), guess, View.from_camera(guess, takes[0].size)
        if shown is not None:
            start = guess if "guess" in way else None
            fit = calibrate_camera(surface.body, shown, start=start, fixed=True, free=free)
            camera, (view,) = fit.camera, fit.views()
            print(fit)
        found = view.project(points)
        away = np.linalg.norm((found - seen)[inside, :2], axis=1)
        turn = (Rotation.from_quat(camera.rotation).inv() * Rotation.from_quat(truth.rotation)).magnitude()
        rows.append({
            "way": way, "median": float(np.median(away)), "p90": float(np.quantile(away, 0.9)),
            "mm": 1e3 * float(np.linalg.norm(np.subtract(camera.position, truth.position))),
            "degrees": float(np.degrees(turn)), "focal": camera.matrix(truth.size)[0, 0] / truth.fx - 1.0,
            "cpu_s": time.process_time() - begun,
        })  # fmt: skip
        print("{way:<16} {median:.2f} px median, 90 % within {p90:.2f}; {mm:.1f} mm, {degrees:.2f} degrees, "
              "focal length {focal:+.1%}; {cpu_s:.0f} s of CPU".format(**rows[-1]), flush=True)  # fmt: skip
    return rows


def main() -> None:
    """Print the table and write overlay pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=data_folder("droid_franka"))
    parser.add_argument("--camera", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--free", default="focal,aspect")
    parser.add_argument("--alone", action="store_true", help="fit each episode by itself, too")
    parser.add_argument("--overlay", type=Path, help="folder for pictures")
    parser.add_argument(
        "--standin", type=Path, nargs="+", metavar="FILE.hdf5", help="use filmed episodes of ALOHA instead"
    )
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    free = tuple(a.free.split(","))
    if a.standin:
        save(standin(a.standin, free), a.out)
        return
    surface, rows = panda(), []
    for camera in a.camera:
        more, fit = one_camera(a.data, surface, camera, free)
        rows += more
        if a.alone:
            rows += alone(a.data, surface, camera, free)
        if a.overlay:
            a.overlay.mkdir(exist_ok=True)
            for episode, view in zip(EPISODES, fit.views(), strict=True):
                picture = overlay(surface.body, footage(a.data, episode, camera, surface), view)
                save_picture(picture, a.overlay / f"camera{camera}_{episode}.png")
    save(rows, a.out)


if __name__ == "__main__":
    main()
