"""The environment that a policy plays whole chunks in, as the simulator shows it or as VisAligner dreams it."""

from __future__ import annotations

from typing import Any

import gymnasium

from embodiedreamer_gym.envs import task_id
from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.evaluation import executed
from embodiedreamer_gym.policies.protocol import picture_inputs
from embodiedreamer_gym.vis_aligner import load_bank
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk
from embodiedreamer_gym.wrappers.vis_aligner import VisAlignerObservationWrapper, VisAlignerVectorWrapper


def policy_world(
    policy: Any, task: str, robot: str = "aloha", execute: int | None = None, dream: str | None = None,
    bank: str = "lab", every: int = 1, envs: int = 1, size: tuple[int, int] | None = None,
) -> Any:  # fmt: skip
    """A task with the cameras of a policy, that takes `execute` actions at once (None: all of a chunk).

    task: id or name; robot: a built-in one or a model file; dream: an aligner, None to see the simulator's pictures, from
    references of a bank, after every n-th action and the last of a chunk; envs: 1, or so many as a vector; size: width and
    height of the simulator's pictures, None for those that the policy learnt from.
    Raises: PolicyError for a policy that looks through other cameras than the one that is dreamed, or so many actions.
    """
    (cameras, learnt), filmed = picture_inputs(policy), {}
    size = size or learnt
    if dream is not None:
        if cameras != ("head",):
            raise PolicyError(f"the policy looks through {', '.join(cameras)}, and only the head camera is dreamed.")
        size = load_bank(bank).size
        filmed = {"camera": "head", "size": size, "every": every}
    count = executed(policy, execute)

    def chunked(env: Any) -> Any:
        return ActionChunk(env, count, **filmed)

    options = {"cameras": cameras, "image_size": size, "robot": robot}
    if envs == 1:
        env = chunked(gymnasium.make(task_id(task), **options))
        return env if dream is None else VisAlignerObservationWrapper(env, dream, bank)
    vector = gymnasium.make_vec(task_id(task), envs, "sync", wrappers=[chunked], **options)
    return vector if dream is None else VisAlignerVectorWrapper(vector, dream, bank)
