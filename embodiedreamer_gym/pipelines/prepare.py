"""Converts real recordings with video to training episodes: each frame with the simulator's view of the same joints."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.engines.robot_view import RobotView
from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.recordings.hdf5 import new_hdf5
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.vis_aligner.bench import PLACE
from embodiedreamer_gym.vis_aligner.clip import Episode
from embodiedreamer_gym.vis_aligner.condition import ROBOT, Condition
from embodiedreamer_gym.vis_aligner.masks import MaskSource, no_masks


def prepare(
    recording: Recording, model: RobotModel, camera: Camera, size: tuple[int, int] | None = None,
    masks: MaskSource = no_masks, progress: ProgressCallback | None = None, table: float | None = None,
) -> Episode:  # fmt: skip
    """Make an episode of a recording: its frames, and the simulator's view of the robot alone at the measured joints.

    camera: the calibrated camera, with the name of the recording's video; size: width and height of the pictures, None
    for the video's own; masks: of the objects in the real frames, which hide the robot where they are nearer; table: height
    of the table top, m, z in the robot's world, for a camera on a link.
    Raises: VisionError if the recording has no such video; SimulationError if it is of another robot.
    """
    if camera.name not in recording.frames:
        raise VisionError(
            f"{recording.name} has no video of camera '{camera.name}'; it has {', '.join(recording.frames) or 'none'}."
        )
    video, real, seen = recording.frames[camera.name], [], []
    shown = progress_or_silence(progress)
    size = size or (video[0].shape[1], video[0].shape[0])
    positions = recording.only(model.joints).position
    with RobotView(model, camera, size, table=table) as view:
        for number, position in enumerate(positions):
            frame = video[number]
            things = masks(frame, number)
            robot = view.at(position)
            real.append(cv2.resize(frame, size, interpolation=cv2.INTER_AREA))
            things = cv2.resize(things, size, interpolation=cv2.INTER_NEAREST)
            classes = np.where(things > ROBOT, things, robot.segmentation)
            parts = np.where(things > ROBOT, 0, robot.parts)
            seen.append(replace(robot, segmentation=classes, parts=parts))
            shown("simulated view", number + 1, len(positions))
    return Episode(recording.name, np.stack(real), Condition(**stacked(seen)), appearance=_place(camera))


def _place(camera: Camera) -> str:
    """Name of a camera's view: a different one for each pose and lens."""
    values = [camera.position, camera.rotation, camera.size, camera.fx, camera.fy, camera.cx, camera.cy]
    return f"{camera.name}{PLACE}{hashlib.sha256(json.dumps(values).encode()).hexdigest()[:8]}"


def write_episode(episode: Episode, path: str | Path, camera: str = "head") -> None:
    """Write an episode for `load_episode`.

    Raises: VisionError if it cannot be written.
    """
    packing = {"compression": "gzip", "compression_opts": 1}
    with new_hdf5(path, VisionError) as file:
        if episode.appearance:
            file.attrs["look"] = json.dumps({"name": episode.appearance})
        file.create_dataset(f"observations/images/{camera}", data=episode.frames, **packing)
        for key, data in vars(episode.condition).items():
            if data is not None:
                data = data.astype(np.float16) if key == "depth" else data
                file.create_dataset(f"observations/sim/{camera}/{key}", data=data, **packing)
