"""Perception errors of a policy: how its actions differ between real photos and generated pictures of the same scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.policies.protocol import Policy, cameras_of, predict
from embodiedreamer_gym.vis_aligner import load_bank
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.perception_errors import PerceptionErrors
from embodiedreamer_gym.wrappers.vis_aligner import conditions

CAMERA = "head"
FEWEST = 2  # photos: the picture of one is composed from the others


def measure_perception(
    policy: Policy, task: str, bank: str = "lab", robot: str = "aloha", progress: ProgressCallback | None = None
) -> PerceptionErrors:
    """Perception errors of a policy in the real photos of a bank whose joints and object poses are known.

    The simulator is set to the scene of each photo, and its picture is composed from the other photos. The error is the
    difference between the policy's actions for the photo and for this picture.

    task: a name in TASKS; bank: lab, or a file; robot: of the simulation.
    Raises: PolicyError for a policy without pictures or with other cameras, or a bank with fewer than two photos with
    known joints and poses; VisionError for a bank without the task's objects.
    """
    if tuple(cameras_of(policy)) != (CAMERA,):
        raise PolicyError(f"perception errors can be measured only for policies with the camera {CAMERA} alone.")
    photos = load_bank(bank)
    env = AlohaEnv(task, robot, "state", image_size=photos.size)
    film, shown = ActionChunk(env, 1, CAMERA, photos.size), progress_or_silence(progress)
    generated, errors = [], []
    try:
        photos = photos.of([prop.name for prop in env.task.props])
        known = tuple(one for one in photos.entries if one.joints is not None and one.poses)
        if len(known) < FEWEST:
            raise PolicyError(
                f"the bank {bank} has {len(known)} photos with known joints and poses; {FEWEST} are needed."
            )
        for number, entry in enumerate(known):
            others = replace(photos, entries=tuple(one for one in known if one is not entry))
            info = film.reset(options=entry.options())[1]
            composed = others.compose(conditions(info)[CAMERA].part(0, 1))
            of_photo, of_composed = (_actions(policy, entry.joints, one) for one in (entry.frame, composed))
            generated.append(of_composed)
            errors.append(of_photo - of_composed)
            shown("photos", number + 1, len(known))
    finally:
        env.close()
    return PerceptionErrors(np.array(generated), np.array(errors))


def _actions(policy: Policy, joints: np.ndarray | None, picture: np.ndarray) -> np.ndarray:
    """A policy's first actions (k, n) for joint positions (n,) and a picture (H, W, 3)."""
    forget = getattr(policy, "reset", None)
    if forget is not None:
        forget()
    batch = {"agent_pos": np.asarray(joints, np.float32)[None], "pixels": {CAMERA: picture[None]}}
    return predict(policy, batch, (1, policy.chunk, policy.action_size))[0].astype(float)
