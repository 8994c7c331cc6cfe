"""`embodiedreamer policy train`."""

from pathlib import Path
from typing import Any

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.errors import PolicyError

PRESETS = {"small": 1e-3, "paper": 1e-5}  # peak learning rates
WIDEST = 160  # pixels; largest default width


@o.verb(
    o.option("--data", "DIR", "ALOHA/AgileX HDF5 files or a LeRobot dataset; several are combined", o.REQUIRED, Path, nargs="+"),
    o.out_folder("output folder: policy, checkpoint and curves"),
    o.option("--steps", "N", "optimiser steps (default: object_pose 8000, act 4000)", None, o.COUNT),
    o.option("--batch", "B", "training examples per step (default: object_pose 64, act 32)", None, o.COUNT),
    o.option("--learning-rate", "R", "peak learning rate (default: small 1e-3, paper 1e-5)", None, o.number(float, 0.0, 1e3, above=True)),
    o.option("--chunk", "K", "actions per chunk", 100, o.COUNT),
    o.option("--cameras", "NAME", "one to three cameras (default: all cameras in the data)", nargs="+"),
    o.option("--size", "WxH", f"image size (default: that of the data, with preset small at most {WIDEST} wide)"),
    o.option("--mirror", "M", f"also train on mirrored demonstrations of this robot with two symmetric arms: {o.MODELS}"),
    o.option("--no-masks", None, "ignore object masks in the data"),
    o.option("--chunk-start-share", "S", "share of the training samples from the first steps of each chunk (default: 0.7);"
           " use 0 if the policy is queried before a chunk has ended", None, o.number(float, 0.0)),
    o.option("--no-rest", None, "do not train the policy to stay at rest after the end of an episode"),
    o.option("--preset", None, "network size", "small", choices=PRESETS),
    o.option("--kind", None, "act: transformer, with object poses as a further input if the data have masks; object_pose: MLP on the object"
             " poses; key_pose: key poses in object frames, of the options above it uses only --data, --out and --cameras (one)"
             " (default: object_pose if the data have masks, else act)", choices=("act", "object_pose", "key_pose")),
    o.option("--robot", "M", f"key_pose: robot of the episodes: {o.MODELS}", "aloha"),
    o.option("--camera-file", "FILE", "key_pose: calibrated cameras (default: the built-in ones)"),
    o.option("--scenes", "N", "key_pose: learn to detect the objects from N generated first frames of other scenes, whose objects have known"
             " shapes, instead of from the images in the data (simulated demonstrations)", None, o.COUNT),
    o.option("--bank", "FILE", "key_pose: bank of photos for --scenes: lab, or a file", "lab"),
    o.DEVICE,
    o.SEED,
    o.QUIET,
)  # fmt: skip
def run(a, progress):
    """Train a policy on demonstrations; an interrupted training resumes."""
    import torch

    from embodiedreamer_gym.learning.device import find_device
    from embodiedreamer_gym.policies.act import TrainingConfig, train
    from embodiedreamer_gym.recordings.episodes import mixed, open_episodes

    device = find_device(a.device)
    if device.type == "cpu":
        torch.set_num_threads(1)  # on two busy cores, two threads took seven times as long
    if a.scenes is not None and a.kind != "key_pose":
        raise PolicyError("--scenes is only for policies of kind key_pose; give --kind key_pose too.")
    if a.kind == "key_pose":
        return f"{a.out}: {_key_poses(a, progress)}"
    sets = [open_episodes(one) for one in a.data]
    episodes = sets[0] if len(sets) == 1 else mixed(*sets, cameras=a.cameras)
    if len(sets) > 1 and not a.no_masks and not episodes.objects and any(one.objects for one in sets):
        progress.note("the datasets do not have masks of the same objects; training without masks")
    config = network_config(a, episodes, progress.note)
    if a.kind is None:
        progress.note(f"training a policy of kind {config.kind}; --kind chooses another")
    learning_rate = PRESETS[a.preset] if a.learning_rate is None else a.learning_rate
    mirror = () if a.mirror is None else _mirror(a.mirror)
    settings = TrainingConfig.usual(config, steps=a.steps, batch=a.batch, learning_rate=learning_rate, mirror=mirror,
                                    chunk_start_share=a.chunk_start_share, rest=not a.no_rest, seed=a.seed)  # fmt: skip
    return f"{a.out}: {train(episodes, config, settings, a.out, progress, progress.note, str(device))!r}"


def _key_poses(a, progress) -> str:
    """Train a key_pose policy; returns a description of its skill."""
    from embodiedreamer_gym.envs.cameras import CAMERAS, load_cameras
    from embodiedreamer_gym.policies.key_pose.training import train_key_poses
    from embodiedreamer_gym.recordings.episodes import mixed, open_episodes

    if a.scenes is not None:
        from embodiedreamer_gym.pipelines.key_pose_scenes import train_on_scenes

        return str(train_on_scenes(a.data, a.out, a.scenes, a.bank, a.robot, a.seed, progress).skill)
    known = CAMERAS if a.camera_file is None else load_cameras(a.camera_file)
    names = a.cameras or ["head"]
    if len(names) != 1 or names[0] not in known:
        raise PolicyError(
            f"a key_pose policy needs exactly one fixed camera; give --cameras with one of {', '.join(known)}."
        )
    sets = [open_episodes(one) for one in a.data]
    episodes = sets[0] if len(sets) == 1 else mixed(*sets, cameras=names)
    return str(train_key_poses(episodes, a.robot, known[names[0]], a.out, a.seed, progress).skill)


def _mirror(robot: str) -> tuple[int, ...]:
    from embodiedreamer_gym.envs.robots import load_robot
    from embodiedreamer_gym.robot.mirror import mirrored_joints

    return mirrored_joints(load_robot(robot))


def network_config(a, episodes, note) -> Any:
    """Return the network's configuration, from the options and the episodes."""
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.policies.act import ActConfig, check_cameras, picture_size, with_object_poses

    cameras = tuple(a.cameras or episodes.cameras)
    check_cameras(episodes, cameras)
    if not cameras:
        raise PolicyError(
            f"the episodes in {a.data[0]} have no pictures, but a policy needs pictures of at least one camera."
        )
    source = picture_size(episodes, cameras[0])
    size = default_size(source, a.preset) if a.size is None else read_size(a.size)
    if a.size is None and size != source:
        note(f"pictures of {source[0]}x{source[1]} are scaled to {size[0]}x{size[1]}; give --size for another size")
    config = ActConfig(episodes.state_size, episodes.action_size, cameras, size)
    objects = () if a.no_masks else tuple(getattr(episodes, "objects", ()))
    if a.kind == "object_pose" and (a.preset == "paper" or not objects):
        raise PolicyError(
            "a policy of kind object_pose learns from masks and does not have the preset paper; use --kind act."
        )
    if a.preset == "paper":
        config = config.paper()
    elif objects and a.kind != "act":
        config = with_object_poses(config, episodes)
    else:
        config = config.small(objects)
    return config.with_(chunk=a.chunk, source_size=None if source == size else source)


def default_size(size: tuple[int, int], preset: str) -> tuple[int, int]:
    """Return a picture size at which the small preset trains in minutes; at 640 x 480 its attention needs gigabytes."""
    width, height = size
    if preset != "small" or width <= WIDEST:
        return size
    return WIDEST, max(1, round(height * WIDEST / width))
