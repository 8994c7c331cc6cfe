"""LeRobot reads a LeRobot set that this package wrote; run it in LeRobot's own environment.

python lerobot_reads.py SET --against FOLDER [--every K]

FOLDER holds the HDF5 episodes of the same demonstrations (`embodiedreamer demos` with the same seed and
`--format aloha`). States and actions must be bit-identical; each frame must be closest to its own original.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import re
from pathlib import Path

import h5py
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

CHUNK = 8  # actions read at once
APART = 10  # distance in frames to a wrong frame, for the error that a wrong frame would give


def originals(folder: Path) -> list[dict]:
    """Numbers and frames of the HDF5 episodes, in order."""
    paths = sorted(folder.glob("episode_*.hdf5"), key=lambda path: int(re.sub(r"\D", "", path.stem)))
    found = []
    for path in paths:
        with h5py.File(path) as file:
            frames = {name: data[()] for name, data in file["observations/images"].items()}
            found.append({"state": file["observations/qpos"][()], "action": file["action"][()], "frames": frames,
                          "task": file.attrs["instruction"]})  # fmt: skip
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", type=Path)
    parser.add_argument("--against", type=Path, required=True)
    parser.add_argument("--every", type=int, default=1, help="number of steps between compared frames")
    arguments = parser.parse_args()
    episodes = originals(arguments.against)
    rate = LeRobotDataset("local/written", root=arguments.set, video_backend="pyav").fps
    chunk = [k / rate for k in range(CHUNK)]
    read = LeRobotDataset("local/written", root=arguments.set, delta_timestamps={"action": chunk}, video_backend="pyav")
    print(f"lerobot {importlib.metadata.version('lerobot')}: {read.num_episodes} episodes, {read.num_frames} steps, "
          f"{read.fps} Hz, cameras {', '.join(read.meta.video_keys)}, statistics {', '.join(read.meta.stats['action'])}")  # fmt: skip
    state, action, right, wrong = [], [], [], []
    index = 0
    for original in episodes:
        for step in range(len(original["state"])):
            if step % arguments.every == 0:
                item = read[index]
                state.append(np.abs(item["observation.state"].numpy() - original["state"][step]).max())
                rows = np.minimum(step + np.arange(CHUNK), len(original["action"]) - 1)
                action.append(np.abs(item["action"].numpy() - original["action"][rows]).max())
                if item["task"] != original["task"]:
                    raise SystemExit(f"step {index}: the task is {item['task']!r}, not {original['task']!r}")
                for camera, frames in original["frames"].items():
                    seen = item[f"observation.images.{camera}"].numpy().transpose(1, 2, 0) * 255.0
                    right.append(np.abs(seen - frames[step]).mean())
                    wrong.append(np.abs(seen - frames[(step + APART) % len(frames)]).mean())
            index += 1
    print(
        f"state: largest error {max(state):g}; chunks of {CHUNK} actions: {max(action):g}; {len(state)} steps looked at"
    )
    print(f"frames: mean absolute error {np.mean(right):.2f} of 255, the worst {max(right):.2f}; "
          f"of a frame {APART} steps later {np.mean(wrong):.2f}")  # fmt: skip
    if index != read.num_frames or max(state) > 0 or max(action) > 0:
        raise SystemExit("LeRobot reads something other than what was written")


if __name__ == "__main__":
    main()
