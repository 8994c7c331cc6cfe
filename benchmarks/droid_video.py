"""Real Franka clips: VisAligner fine-tuned on seven of nine episodes, and compared with copying on the other two.

python -m benchmarks.droid_camera --camera 0 --out cam0.json    (and 1)
python -m benchmarks.droid_video --cameras cam0.json cam1.json --out DIR [--steps 3000] [--aligner lean]
                              [--strips DIR] [--json FILE]

One model for both static cameras, from the shipped weights; pictures of 160 x 96. The last two episodes are held out.
The objects' masks are not known, and neither is the bench's background, since the cameras were moved between episodes;
the model therefore does not see which objects the hand moves. Everything is done twice, with the Panda's own hand and
with the hand that `vis carve` finds in the training episodes (except those with a doubtful camera). Each model has a
gallery of the training episodes. "hand": pixels that show the hand, the same pixels in both cases. Data: see
droid_camera.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pybullet_data
import torch

from benchmarks.common import data_folder, save
from benchmarks.droid_camera import EPISODES, JOINTS, joint_angles
from embodiedreamer_gym.engines.bullet.client import World
from embodiedreamer_gym.engines.bullet.rendering import Renderer
from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.robot.carved_urdf import add_visual
from embodiedreamer_gym.robot.surface import Surface
from embodiedreamer_gym.vis_aligner import Condition, Episode, load_aligner, metrics
from embodiedreamer_gym.vis_aligner.bench import make_gallery
from embodiedreamer_gym.vis_aligner.camera_calibration import Footage
from embodiedreamer_gym.vis_aligner.camera_calibration.video import VideoFrames
from embodiedreamer_gym.vis_aligner.carving import carve
from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.condition import ROBOT
from embodiedreamer_gym.vis_aligner.held_out import AFTER_TRUE, CLOSED, HeldOutResult, evaluate_aligner, tables
from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train

PANDA = Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"
HAND, ARM_PARTS = "panda_hand", 9  # number of arm parts; the hand and fingers follow them
SIZE = (160, 96)
HELD = EPISODES[-2:]


def cameras(path: Path) -> tuple[dict[str, Camera], set[str]]:
    """Cameras by episode and episodes with a doubtful camera, from a file of droid_camera.

    Of the fits to all nine episodes, the one with the smallest error of the unused marks is taken.
    """
    fits = [row for row in json.loads(path.read_text()) if row["stands"] == len(EPISODES)]
    if not fits:
        raise SystemExit(
            f"{path} contains no camera that was fitted to all {len(EPISODES)} episodes; run droid_camera again."
        )
    best = min(fits, key=lambda row: row["median"])["fit"]
    found = {e: Camera(**stand["camera"]) for e, stand in zip(EPISODES, best["stands"], strict=True)}
    return found, {name.rpartition("/")[2] for name in best["doubtful"]}


def carved(data: Path, found: Sequence[tuple[dict[str, Camera], set[str]]], out: Path) -> Path:
    """The Panda's URDF with the real hand, carved from the training episodes."""
    surface, footage, places = Surface(PANDA, JOINTS), [], []
    for number, (places_of, doubtful) in enumerate(found):
        for episode in [e for e in EPISODES if e not in HELD and e not in doubtful]:
            angles = joint_angles(data, episode)
            frames = VideoFrames(data / "videos" / episode / f"{number}.mp4", len(angles))
            footage.append(Footage(frames, surface.link_poses(HAND, angles)[:, None], name=episode))
            places.append(places_of[episode])
    shape = carve(footage, places)
    print(f"{shape!r} from {len(footage)} clips")
    add_visual(PANDA, HAND, shape.vertices, shape.faces, (shape.colour / 255).tolist(), out)
    return out


def episodes(data: Path, number: int, found: dict[str, Camera], urdf: Path) -> dict[str, Episode]:
    """Episodes with real frames and the robot simulated at the same joint positions."""
    client, made = World(), {}
    robot = client.loadURDF(str(urdf), useFixedBase=True)
    index = {client.getJointInfo(robot, j)[1].decode(): j for j in range(client.getNumJoints(robot))}
    parts = [(robot, link) for link in range(-1, client.getNumJoints(robot))]
    renderer = Renderer(client, "tiny", SIZE)
    for episode, camera in found.items():
        angles, seen = joint_angles(data, episode), []
        for row in angles:
            for name, angle in zip(JOINTS, row, strict=True):
                client.resetJointState(robot, index[name], angle)
            seen.append(renderer.capture(camera, SIZE, classes={robot: ROBOT}, parts=parts))
        video = VideoFrames(data / "videos" / episode / f"{number}.mp4", len(angles))
        frames = np.stack([cv2.resize(video[k], SIZE, interpolation=cv2.INTER_AREA) for k in range(len(angles))])
        condition = Condition(**stacked(seen))
        made[episode] = Episode(f"{episode}_camera{number}", frames, condition, appearance=f"camera{number}/{episode}")
    renderer.close()
    client.disconnect()
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, then print the tables of the held-out episodes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.droid_video", description=str(__doc__).splitlines()[0])
    parser.add_argument("--data", type=Path, default=data_folder("droid_franka"))
    parser.add_argument(
        "--cameras", type=Path, nargs=2, required=True, metavar="FILE", help="calibrations of cameras 0 and 1"
    )
    parser.add_argument("--out", type=Path, required=True, help="output folder; an interrupted run resumes")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--aligner", default="lean", help="model to start from (default %(default)s)")
    parser.add_argument("--strips", type=Path, help="folder for pictures")
    parser.add_argument("--json", type=Path, metavar="FILE", help="figures as JSON")
    a = parser.parse_args(arguments)
    torch.set_num_threads(1)
    a.out.mkdir(parents=True, exist_ok=True)
    found = [cameras(path) for path in a.cameras]
    robots = {"URDF": PANDA, "carved hand": carved(a.data, found, a.out / "panda_carved.urdf")}
    films = {
        name: [episodes(a.data, number, places, urdf) for number, (places, _) in enumerate(found)]
        for name, urdf in robots.items()
    }
    judged = {name: judge(a, name, both) for name, both in films.items()}
    rows = []
    for number, with_hand in enumerate(films["carved hand"]):
        for name, results in judged.items():
            print(f"\n## camera {number}, {name}, episodes {' and '.join(HELD)}, not seen in training\n")
            print(tables(results[number], markdown=True))
            errors = [
                hand_error(result, with_hand[e].condition) for result, e in zip(results[number], HELD, strict=True)
            ]
            row: dict[str, Any] = {"camera": number, "robot": name, "hand": {}}
            for way in (AFTER_TRUE, CLOSED):
                row["hand"][way] = [10 * np.log10(255**2 / error[way]) for error in errors]
                shown = ", ".join(f"{value:.1f}" for value in row["hand"][way])
                print(f"hand, {way}: {np.mean(row['hand'][way]):.2f} dB ({shown})")
            for kind in ("copy last", AFTER_TRUE, CLOSED):
                row[kind] = {
                    key: [one.measures[kind][key] for one in results[number]] for key in ("psnr", "psnr.moving")
                }
            rows.append(row)
    save(rows, a.json)
    if a.strips is not None:
        a.strips.mkdir(parents=True, exist_ok=True)
        for plain, better in zip(*(itertools.chain(*results) for results in judged.values()), strict=True):
            clips = {"simulated": better.clips["simulated"], "without": plain.clips[CLOSED], "carved": better.clips[CLOSED],
                     "real": better.clips["real"]}  # fmt: skip
            save_picture(metrics.strip(clips, columns=6), a.strips / f"droid_{better.episode.name}.jpg")


def judge(a: argparse.Namespace, name: str, both: Sequence[dict[str, Episode]]) -> list[list[HeldOutResult]]:
    """Train on the training episodes and evaluate the held-out ones; results by camera and episode."""
    aligner = load_aligner(a.aligner)

    def show(stage: str, step: int, of: int | None = None, /, **values: Any) -> None:
        if step % 100 == 0:
            print(f"{name}, {stage}: step {step} of {of}", flush=True)

    known = [[one[e] for e in EPISODES if e not in HELD] for one in both]
    out = a.out / name.replace(" ", "_")
    config = TrainingConfig(steps=a.steps, learning_rate=5e-4)
    train(aligner, list(itertools.chain(*known)), config, out, show)
    save_aligner(aligner, out)
    nothing = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    benches = [Bench(nothing, nothing[..., 0] > 0, make_gallery(those)) for those in known]
    return [
        [evaluate_aligner(aligner, one[e], bench=bench) for e in HELD] for one, bench in zip(both, benches, strict=True)
    ]


def hand_error(result: HeldOutResult, condition: Condition) -> dict[str, float]:
    """Mean square error of the pixels that show the hand in `condition`."""
    real = result.clips["real"].astype(float)
    hand = np.asarray(condition.parts)[1 : len(real) + 1] > ARM_PARTS
    return {way: float(((result.clips[way] - real)[hand] ** 2).mean()) for way in (AFTER_TRUE, CLOSED)}


if __name__ == "__main__":
    main()
