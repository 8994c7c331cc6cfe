"""The environment of a task in the stand-in world."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium as gym

from embodiedreamer_gym.envs import task_id
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.standin.bench.engine import Effects, Pictures, StandInWorld
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk


@renamed_arguments(look="appearance")
def make_stand_in(
    task: str = "PutCupOnMat",
    effects: Effects | None = None,
    chunk: int = 100,
    appearance: str = "lab",
    size: tuple[int, int] = (128, 96),
    seed_of_robot: int | None = 0,
    pictures: str | Pictures = "traced",
    control_hz: int = 30,
    blender: str | None = None,
    wrap: Callable[[gym.Env], gym.Env] | None = None,
) -> ActionChunk:
    """The ALOHA environment of a task in the stand-in world; a step plays a chunk of actions and gives one picture.

    task: a name in TASKS.
    effects, seed_of_robot, pictures, blender: see `StandInWorld`.
    chunk: number of actions (chunk, 14) in one step, see `ActionChunk`.
    appearance: of the bench: lab, or an integer as the seed of a random one.
    size: width and height of a picture, pixels.
    control_hz: actions per second.
    wrap: adds a wrapper to the environment of single actions, such as `CalibratedTracking`.
    Raises: ModelError, EffectError, SimulationError or VisionError with the allowed values; MissingExtraError.
    """
    world = StandInWorld(effects, seed_of_robot, appearance, pictures, blender)
    env = gym.make(task_id(task), engine=world, image_size=size, control_hz=control_hz, disable_env_checker=True)
    return ActionChunk(env if wrap is None else wrap(env), chunk)
