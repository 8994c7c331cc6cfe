"""The environment in which a policy plays chunks, with pictures from the simulator or from VisAligner."""

from __future__ import annotations

from typing import Any

import gymnasium

from embodiedreamer_gym.envs import task_id
from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.evaluation import executed
from embodiedreamer_gym.policies.protocol import picture_inputs
from embodiedreamer_gym.vis_aligner import load_bank
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.calibrated_tracking import CalibratedTracking
from embodiedreamer_gym.wrappers.perception_errors import PerceptionErrorWrapper
from embodiedreamer_gym.wrappers.vis_aligner import VisAlignerObservationWrapper, VisAlignerVectorWrapper


def policy_world(
    policy: Any, task: str, robot: str = "aloha", execute: int | None = None, vis_aligner: str | None = None,
    bank: str = "lab", every: int = 1, envs: int = 1, size: tuple[int, int] | None = None, chunks: bool = True,
    tracking: str | None = None, tracking_mode: str = "both", learnt_on: str = "aloha",
    randomize: str | None = None, perception: str | None = None, engine: str = "auto",
) -> Any:  # fmt: skip
    """Make a task's environment for a policy: with its cameras, and taking `execute` actions at once.

    policy: determines the cameras, the picture size and the chunk.
    task: id or name.
    robot: a built-in robot or a model file.
    execute: actions per step, None for all of a chunk.
    vis_aligner: an aligner that generates the pictures, None for the simulator's.
    bank: photos that the aligner starts from.
    every: actions from one generated picture to the next; the last action of a chunk always has one.
    envs: 1, or the number of environments of a vector.
    size: width and height of the pictures, None for those of the policy's training, or the bank's.
    chunks: False for one environment with the simulator's pictures that takes single actions.
    tracking, tracking_mode: calibrated model and mode of a `CalibratedTracking`. None: no tracking or, for a policy
        whose actions are `positions`, the robot's own model.
    learnt_on: robot whose commands the policy gives, if they are not positions.
    randomize: as in `AlohaEnv`; commands through the calibrated model keep its own parameters.
    perception: file of the policy's perception errors, see `PerceptionErrorWrapper`.
    engine: as in `AlohaEnv`.
    Raises: PolicyError for larger pictures than the bank's, for too many actions, or for perception errors in a
    vector or without chunks.
    """
    count, (cameras, learnt), filmed = executed(policy, execute), picture_inputs(policy), {}
    if vis_aligner is not None:
        photos = load_bank(bank).size
        needed = size or learnt or photos
        if size not in (None, photos) or needed[0] > photos[0] or needed[1] > photos[1]:
            raise PolicyError(
                f"pictures of {needed[0]} x {needed[1]} are requested, but the bank's photos are {photos[0]} x "
                f"{photos[1]}; give a bank of that size, which `embodiedreamer vis bank` makes from episodes of that "
                "size."
            )
        size = photos
        filmed = {"camera": cameras, "size": size, "every": every}

    positions = bool(getattr(policy, "positions", False))
    model = robot if tracking is None and positions else tracking

    def tracked(env: Any) -> Any:
        return env if model is None else CalibratedTracking(env, model, tracking_mode, None if positions else learnt_on)

    def chunked(env: Any) -> Any:
        return ActionChunk(tracked(env), count, **filmed)

    def erring(env: Any) -> Any:
        return env if perception is None else PerceptionErrorWrapper(env, perception)

    if perception is not None and (envs > 1 or not chunks):
        raise PolicyError(
            "perception errors need one environment that takes chunks; leave --envs, --video and --ensemble out."
        )
    options = {"cameras": cameras, "image_size": size or learnt or (128, 96), "robot": robot, "randomize": randomize,
               "engine": engine}  # fmt: skip
    if envs == 1:
        env = gymnasium.make(task_id(task), **options)
        env = chunked(env) if chunks else tracked(env)
        return erring(
            env if vis_aligner is None else VisAlignerObservationWrapper(env, vis_aligner, bank, cameras=cameras)
        )
    vector = gymnasium.make_vec(task_id(task), envs, "sync", wrappers=[chunked], **options)
    return vector if vis_aligner is None else VisAlignerVectorWrapper(vector, vis_aligner, bank, cameras=cameras)
