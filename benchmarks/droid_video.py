"""Real Franka clips: VisAligner fine-tuned on seven of the nine episodes, the other two beside copying.

python -m benchmarks.droid_camera --camera 0 --out cam0.json    (and 1)
python -m benchmarks.droid_video --cameras cam0.json cam1.json --out DIR [--steps 3000] [--aligner lean] [--strips DIR]

One model for both static cameras, from the shipped weights; pictures of 160 x 96. The last two episodes are held out. The
objects' masks are not known, nor is the bench's backdrop: the cameras were pushed between episodes. What a hand moves is
therefore not told to the model. Data: see droid_camera.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pybullet_data
import torch

from benchmarks.common import data_folder
from benchmarks.droid_camera import EPISODES, JOINTS, joint_angles
from embodiedreamer_gym.engines.bullet.client import World
from embodiedreamer_gym.engines.bullet.rendering import Renderer
from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.vis_aligner import Condition, Episode, load_aligner, metrics
from embodiedreamer_gym.vis_aligner.camera_calibration.video import VideoFrames
from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
from embodiedreamer_gym.vis_aligner.clip import ROBOT
from embodiedreamer_gym.vis_aligner.held_out import evaluate_aligner, tables
from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train

SIZE = (160, 96)
HELD = EPISODES[-2:]


def cameras(path: Path) -> dict[str, Camera]:
    """Episode -> camera, of that fit in a file of droid_camera that is nearest to unused marks in all nine places."""
    fits = [row for row in json.loads(path.read_text()) if row["stands"] == len(EPISODES)]
    if not fits:
        raise SystemExit(f"{path} holds no camera of all {len(EPISODES)} episodes; run droid_camera again.")
    best = min(fits, key=lambda row: row["median"])["fit"]["stands"]
    return {e: Camera(**stand["camera"]) for e, stand in zip(EPISODES, best, strict=True)}


def episodes(data: Path, number: int, found: dict[str, Camera]) -> dict[str, Episode]:
    """Real frames and the simulated Panda in the same joint positions."""
    client, made = World(), {}
    urdf = Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"
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
        name = f"{episode}_camera{number}"
        made[episode] = Episode(name, frames, Condition(**stacked(seen)), appearance=name)
    renderer.close()
    client.disconnect()
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, then print the tables of the held-out episodes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.droid_video", description=str(__doc__).splitlines()[0])
    parser.add_argument("--data", type=Path, default=data_folder("droid_franka"))
    parser.add_argument("--cameras", type=Path, nargs=2, required=True, metavar="FILE", help="of cameras 0 and 1")
    parser.add_argument("--out", type=Path, required=True, help="goes on where it was")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--aligner", default="lean", help="to start from (default %(default)s)")
    parser.add_argument("--strips", type=Path, help="folder for pictures")
    a = parser.parse_args(arguments)
    torch.set_num_threads(1)
    both = [episodes(a.data, number, cameras(path)) for number, path in enumerate(a.cameras)]
    aligner = load_aligner(a.aligner)

    def said(stage: str, step: int, loss: float) -> None:
        if step % 100 == 0:
            print(f"{stage}: step {step} of {a.steps}, loss {loss:.4f}", flush=True)

    known = [one[e] for one in both for e in EPISODES if e not in HELD]
    train(aligner, known, TrainingConfig(steps=a.steps, learning_rate=5e-4), a.out, said)  # pyright: ignore[reportArgumentType]
    save_aligner(aligner, a.out)
    for number, one in enumerate(both):
        judged = [evaluate_aligner(aligner, one[e]) for e in HELD]
        print(
            f"\n## camera {number}, episodes {' and '.join(HELD)}, not seen in training\n\n{tables(judged, markdown=True)}"
        )
        if a.strips is not None:
            a.strips.mkdir(parents=True, exist_ok=True)
            for j in judged:
                save_picture(metrics.strip(j.clips, columns=6), a.strips / f"droid_{j.episode.name}.jpg")


if __name__ == "__main__":
    main()
