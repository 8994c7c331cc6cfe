"""The tasks for LeRobot: push this folder to the Hugging Face Hub, and `make_env` of LeRobot loads it from there.

Source: https://huggingface.co/docs/lerobot/envhub
"""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym

from embodiedreamer_gym.envs import NAMES
from embodiedreamer_gym.envs.reset_options import RESET_OPTIONS

SUITE = "embodiedreamer"
ARGUMENTS: dict[str, Any] = {  # of the environments; add robot="my_calibrated_arm.json" here
    "obs_type": "pixels_agent_pos", "cameras": ("head", "left_wrist", "right_wrist"), "image_size": (320, 240),
    "render_mode": "rgb_array",
}  # fmt: skip


class LeRobotEnv(gym.ObservationWrapper):
    """Adds the task in words and the name of a single camera, and ignores LeRobot's own reset options."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        (self.camera, *others), space = ARGUMENTS["cameras"], env.observation_space
        self.single = not others
        if self.single:  # LeRobot's policies expect observation.images.CAMERA, and would get observation.image
            self.observation_space = gym.spaces.Dict(
                {**space, "pixels": gym.spaces.Dict({self.camera: space["pixels"]})}
            )

    @property
    def task(self) -> str:
        return self.env.get_wrapper_attr("task_description")

    @property
    def task_description(self) -> str:
        return self.task

    def observation(self, observation: Any) -> Any:
        return {**observation, "pixels": {self.camera: observation["pixels"]}} if self.single else observation

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        known = {key: value for key, value in (options or {}).items() if key in RESET_OPTIONS}
        return super().reset(seed=seed, options=known)


def make_one(task: str, control_hz: int) -> gym.Env:
    """Make one environment; its id names the module, which a new process has not imported yet."""
    return LeRobotEnv(gym.make(f"embodiedreamer_gym:EmbodieDreamer/{task}-v0", control_hz=control_hz, **ARGUMENTS))


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None
) -> dict[str, dict[int, gym.vector.VectorEnv]]:
    """{suite: {task number: n_envs environments}}: all tasks, or the one that cfg.task names, at cfg.fps."""
    wanted = getattr(cfg, "task", None)
    if wanted not in (None, *NAMES):
        raise ValueError(f"task {wanted!r} is not one of {', '.join(NAMES)}.")
    kind = partial(gym.vector.AsyncVectorEnv, context="spawn") if use_async_envs else gym.vector.SyncVectorEnv
    same_step = gym.vector.AutoresetMode.SAME_STEP  # LeRobot reads info["final_info"]
    rate = int(getattr(cfg, "fps", 30))
    return {
        SUITE: {
            number: kind([partial(make_one, task, rate)] * n_envs, autoreset_mode=same_step)
            for number, task in enumerate(NAMES)
            if wanted in (None, task)
        }
    }
