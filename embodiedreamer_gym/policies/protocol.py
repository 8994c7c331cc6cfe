"""What a policy is, and where one comes from: a folder, or a function of the user's."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from embodiedreamer_gym.errors import PolicyError

HOW = "a folder of `embodiedreamer policy train`, a folder with a LeRobot ACT checkpoint, or package.module:function"


@runtime_checkable
class Policy(Protocol):
    """Gives actions (B, k, m) float32, in the environment's units, for a batch of observations.

    A batch is {"agent_pos": (B, n) float32, "pixels": {camera: (B, H, W, 3) uint8}}. A policy with a memory has a method
    `reset()` too, which is called before each episode; one that needs certain cameras names them in `cameras`.
    """

    action_size: int
    chunk: int

    def __call__(self, batch: Mapping[str, Any]) -> np.ndarray:
        """Actions (B, k, m)."""
        ...


def load_policy(spec: str | Path) -> Policy:
    """The policy in a folder, or what the user's `package.module:function` returns when it is called.

    The module is imported, which runs its code.
    Raises: PolicyError where there is none.
    """
    folder = Path(spec)
    if folder.is_dir():
        from embodiedreamer_gym.policies.act.lerobot import is_lerobot, load_lerobot
        from embodiedreamer_gym.policies.act.policy import ActPolicy

        return load_lerobot(folder) if is_lerobot(folder) else ActPolicy.load(folder)
    module, colon, name = str(spec).partition(":")
    if not colon or not all(part.isidentifier() for part in [*module.split("."), name]):
        raise PolicyError(f"policy {spec} is no folder and no function; give {HOW}.")
    return _made(str(spec), module, name)


def _made(spec: str, module: str, name: str) -> Policy:
    """What a user's function returns."""
    try:
        make = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise PolicyError(f"policy {spec} cannot be imported: {error}.") from error
    policy = make() if callable(make) else None
    if not isinstance(policy, Policy) or not callable(policy):
        raise PolicyError(
            f"policy {spec} must be a function without arguments that returns a policy: something to call with a batch, "
            "with the attributes action_size and chunk."
        )
    return policy


def sight(policy: Any) -> tuple[tuple[str, ...], tuple[int, int]]:
    """Cameras that a policy looks through, and width and height of the pictures it learnt from; head and 128 x 96 else."""
    config = getattr(getattr(policy, "network", None), "config", None)
    size = (128, 96) if config is None else getattr(config, "source_size", None) or config.image_size
    return tuple(getattr(policy, "cameras", ())) or ("head",), size
