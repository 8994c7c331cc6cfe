"""Key poses with an object pose head trained on generated first frames of many scenes, not on demonstration frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.table import TABLE_HEIGHT
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.pipelines.replay_episodes import read_source, source_files
from embodiedreamer_gym.policies.act.object_pose_head import ObjectPoseHead
from embodiedreamer_gym.policies.key_pose import Demonstration, KeyPosePolicy, learn
from embodiedreamer_gym.policies.key_pose.arms import Arms
from embodiedreamer_gym.policies.key_pose.looking import Looker, areas_of, normalised
from embodiedreamer_gym.policies.key_pose.training import save_key_poses
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.vis_aligner import load_bank
from embodiedreamer_gym.vis_aligner.condition import OBJECT
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.vis_aligner import conditions

CAMERA = "head"
FIRST_SEED = 300_000  # of the scenes
STEPS_AS_EPISODES = 125  # the head is trained with the steps for this many episodes: 1000
SIZE = (128, 96)  # of the simulator's pictures; generated ones have that of the bank


@dataclass(frozen=True, eq=False)
class Scenes:
    """Pictures (N, H, W, 3) uint8 and masks (N, H, W): 0 for no object, then 1, 2, ... in the order of `things`."""

    things: tuple[str, ...]
    pictures: np.ndarray
    masks: np.ndarray


def lying(pose: Pose) -> tuple[float, float, float]:
    """Position (m) of an object on the table, and the direction (rad) of its x axis."""
    axis = Rotation.from_quat(pose.quaternion).as_matrix()[:, 0]
    return float(pose.position[0]), float(pose.position[1]), float(np.arctan2(axis[1], axis[0]))


def draw_scenes(task: str, count: int, bank: str | None = "lab", robot: str = "aloha",
                progress: ProgressCallback | None = None) -> Scenes:  # fmt: skip
    """First frames of a task's scenes, composed from the photos of a bank, with its sensor's noise.

    bank: lab, or a file; None for the simulator's pictures. Raises: VisionError for a bank without the task's objects.
    """
    photos = None if bank is None else load_bank(bank)
    size = SIZE if photos is None else photos.size
    env = AlohaEnv(task, robot, "state", image_size=size)
    film, pictures, masks = ActionChunk(env, 1, CAMERA, size), [], []
    things = tuple(prop.name for prop in env.task.props)
    photos = None if photos is None else photos.of(things)
    try:
        for number in range(count):
            _, info = film.reset(seed=FIRST_SEED + number)
            seen = conditions(info)["head"].part(0, 1)
            picture = seen.rgb[0]
            if photos is not None:
                grain = photos.bench.grain if photos.bench is not None and photos.bench.grain else 0.0
                noise = np.random.default_rng(number).normal(0.0, grain, picture.shape)
                picture = np.clip(np.round(photos.start(seen).last + noise), 0, 255).astype(np.uint8)
            pictures.append(picture)
            masks.append(np.where(seen.classes[0] >= OBJECT, seen.classes[0] - (OBJECT - 1), 0).astype(np.uint8))
            progress_or_silence(progress)("scenes", number + 1, count)
    finally:
        env.close()
    return Scenes(things, np.stack(pictures), np.stack(masks))


def looker_of(task: str, scenes: Scenes, seed: int = 0, progress: ProgressCallback | None = None) -> Looker:
    """A `Looker` for a task's objects, whose shapes are known, trained on scenes."""
    torch.manual_seed(seed)
    head = ObjectPoseHead(len(scenes.things))
    head.fit(scenes.pictures, scenes.masks, normalised, seed, progress, STEPS_AS_EPISODES)
    props = TASKS[task]().props
    shapes = {
        prop.name: np.concatenate([s.corners() for s in prop.shapes]) + np.array([0.0, 0.0, TABLE_HEIGHT])
        for prop in props
    }
    heights = {prop.name: TABLE_HEIGHT + 0.5 * prop.size[2] for prop in props}
    where = areas_of(scenes.masks, {name: number for number, name in enumerate(scenes.things, 1)})
    return Looker(head.eval(), scenes.things, CAMERAS[CAMERA], heights, where, shapes)


def shown_in(data: str | Path | Sequence[str | Path]) -> tuple[str, list[Demonstration]]:
    """The task of simulated episodes, and their demonstrations, with the objects' poses in their files.

    Raises: RecordingError for episodes of several tasks, or without task or object poses.
    """
    sources = [read_source(path) for path in source_files(data)]
    tasks = sorted({source.task for source in sources})
    if len(tasks) != 1:
        raise RecordingError(
            f"key poses need episodes of one task, but there are episodes of {', '.join(tasks) or 'none'}."
        )
    shown = [
        Demonstration(
            source.states.astype(float), source.actions.astype(float), source.hz,
            {name: lying(Pose(poses[0][:3], poses[0][3:])) for name, poses in source.objects.items()},
        )
        for source in sources
    ]  # fmt: skip
    if not all(one.scene for one in shown):
        raise RecordingError(
            "the episodes do not state where their objects were (/objects/NAME), as those of `demos` do."
        )
    return tasks[0], shown


def train_on_scenes(data: str | Path | Sequence[str | Path], folder: str | Path, count: int, bank: str | None = "lab", robot: str = "aloha",
                    seed: int = 0, progress: ProgressCallback | None = None) -> KeyPosePolicy:  # fmt: skip
    """Learn key poses from simulated demonstrations with known object poses, and an object pose head from scenes.

    data: HDF5 files of one task; folder: where the policy is saved; count: of scenes; bank: see `draw_scenes`.
    Raises: RecordingError for episodes of several tasks, or without task or object poses; PolicyError for episodes from
    which key poses cannot be learnt.
    """
    task, shown = shown_in(data)
    model = RobotModel.load(robot)
    skill = learn(shown, Arms(model))
    scenes = draw_scenes(task, count, bank, robot, progress)
    looker = looker_of(task, scenes, seed, progress)
    size = scenes.pictures.shape[2], scenes.pictures.shape[1]
    policy = KeyPosePolicy(skill, model, looker, shown[0].hz, (CAMERA,), size)
    save_key_poses(policy, looker, robot, Path(folder))
    return policy
