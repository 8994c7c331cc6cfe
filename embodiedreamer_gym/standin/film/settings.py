"""Settings of a film: task, appearance, picture size, and which control steps are rendered."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.standin.film.appearance_library import find_appearance

RECIPE = 2  # version of the pictures: increase it with every change that alters them for the same settings
MIN_FRAMES = 10  # samples that a recording must have
STEPS = 300  # control steps of an episode
MAX_EVERY = (STEPS - 1) // (MIN_FRAMES - 1)
SIZES = (16, 2048)  # pixels: smallest and largest edge of a picture
MINIMUM = {"seed": 0, "frames": MIN_FRAMES, "every": 1, "samples": 1}


def check_size(size: tuple[int, int]) -> None:
    """Raises: VisionError for a width or height outside SIZES."""
    if not all(SIZES[0] <= edge <= SIZES[1] for edge in size):
        raise VisionError(f"pictures cannot be {size[0]} x {size[1]} pixels; each may be {SIZES[0]} to {SIZES[1]}.")


@dataclass(frozen=True)
class FilmSettings:
    """Settings of a film.

    Raises: VisionError or SimulationError for a value outside its range.
    """

    task: str
    """A name in TASKS."""
    appearance: str = "lab"
    """lab, many (a random one per episode), or an integer as the seed of a random one."""
    size: tuple[int, int] = (128, 96)
    """Width and height of the pictures."""
    seed: int = 0
    """Seed of all random draws."""
    frames: int | None = None
    """Largest number of pictures, of consecutive samples from a random start; None: the whole episode."""
    every: int = 1
    """Control steps from one picture to the next."""
    samples: int = 4
    """Light paths per pixel."""
    cameras: tuple[str, ...] = ("head",)
    """Names in CAMERAS."""

    def __post_init__(self) -> None:
        if self.task not in TASKS:
            raise SimulationError(f"there is no task '{self.task}'; give one of {', '.join(TASKS)}.")
        find_appearance(self.appearance, 0)
        check_size(self.size)
        for name in self.cameras:
            if name not in CAMERAS:
                raise SimulationError(f"there is no camera '{name}'; give one of {', '.join(CAMERAS)}.")
        if len(set(self.cameras)) != len(self.cameras) or not self.cameras:
            raise SimulationError("name at least one camera, and each once.")
        for name, smallest in MINIMUM.items():
            value = getattr(self, name)
            if value is not None and value < smallest:
                raise VisionError(f"{name} is {value}, but must be at least {smallest}.")
        if self.every > MAX_EVERY:
            raise VisionError(
                f"every is {self.every}, but must be at most {MAX_EVERY}, so that {MIN_FRAMES} pictures of a recording are left."
            )

    def as_dict(self, number: int) -> dict[str, Any]:
        """All settings on which the file of episode `number` depends, as JSON-compatible data.

        The key of the appearance is "look", as in files of earlier releases.
        """
        views = {} if self.cameras == ("head",) else {"cameras": list(self.cameras)}
        return {"task": self.task, "look": self.appearance, "size": list(self.size), "seed": self.seed,
                "frames": self.frames, "every": self.every, "samples": self.samples,
                "episode": number, "recipe": RECIPE, **views}  # fmt: skip

    def episode_seed(self, number: int) -> int:
        """Seed of an episode, also of the environment's reset."""
        return int(np.random.SeedSequence([self.seed, zlib.crc32(self.task.encode()), number]).generate_state(1)[0])

    def path(self, folder: Path, number: int) -> Path:
        """File of an episode."""
        return folder / f"{self.task}_{number:03d}.hdf5"

    def choose_steps(self, active_steps: int, number: int) -> np.ndarray:
        """Numbers of the control steps to render; active_steps: of the episode, up to its last motion.

        Steps after the last motion are added if a recording would otherwise have fewer than MIN_FRAMES samples.
        """
        steps = np.arange(0, max(active_steps, (MIN_FRAMES - 1) * self.every + 1), self.every)
        if self.frames is None or len(steps) <= self.frames:
            return steps
        span = (self.frames - 1) * self.every + 1
        rng = np.random.default_rng([self.episode_seed(number), 1])
        return int(rng.integers(max(active_steps - span, 0) + 1)) + np.arange(self.frames) * self.every
