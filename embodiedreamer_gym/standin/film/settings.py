"""What is to be filmed."""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.standin.film.appearance_library import find_look

RECIPE = 2  # to be raised with whatever changes the pictures of the same settings
FEWEST = 10  # samples that a recording must have
STEPS = 300  # control steps of an episode
MOST_APART = (STEPS - 1) // (FEWEST - 1)
SIZES = (16, 2048)
LEAST = {"seed": 0, "frames": FEWEST, "every": 1, "samples": 1}


def check_size(size: tuple[int, int]) -> None:
    """Raises: VisionError for pictures of a width and height that cannot be."""
    if not all(SIZES[0] <= edge <= SIZES[1] for edge in size):
        raise VisionError(f"pictures cannot be {size[0]} x {size[1]} pixels; each may be {SIZES[0]} to {SIZES[1]}.")


@dataclass(frozen=True)
class Film:
    """Episodes of a task in a look, pictures of a size (width, height).

    look: lab, many or a whole number; seed: of everything drawn; frames: at most, a stretch that begins at random (None:
    the whole episode); every: control steps from one to the next; samples: light paths per pixel.
    Raises: VisionError or SimulationError for what cannot be.
    """

    task: str
    look: str = "lab"
    size: tuple[int, int] = (128, 96)
    seed: int = 0
    frames: int | None = None
    every: int = 1
    samples: int = 4

    def __post_init__(self) -> None:
        if self.task not in TASKS:
            raise SimulationError(f"there is no task '{self.task}'; there are {', '.join(TASKS)}.")
        find_look(self.look, 0)
        check_size(self.size)
        for name, smallest in LEAST.items():
            value = getattr(self, name)
            if value is not None and value < smallest:
                raise VisionError(f"{name} is {value}, but must be at least {smallest}.")
        if self.every > MOST_APART:
            raise VisionError(
                f"every is {self.every}, but at most {MOST_APART} leaves the {FEWEST} pictures of a recording."
            )

    def settings(self, number: int) -> dict[str, Any]:
        """All that an episode's file depends on, fit for JSON."""
        return {**asdict(self), "size": list(self.size), "episode": number, "recipe": RECIPE}

    def episode_seed(self, number: int) -> int:
        """Seed of an episode, of the environment's reset too."""
        return int(np.random.SeedSequence([self.seed, zlib.crc32(self.task.encode()), number]).generate_state(1)[0])

    def path(self, folder: Path, number: int) -> Path:
        """Where an episode is kept."""
        return folder / f"{self.task}_{number:03d}.hdf5"

    def choose(self, busy: int, number: int) -> np.ndarray:
        """Control steps that are filmed of an episode in which so many are busy.

        All of them, or a stretch that begins at random; a little of the stillness afterwards where they are too few.
        """
        steps = np.arange(0, max(busy, (FEWEST - 1) * self.every + 1), self.every)
        if self.frames is None or len(steps) <= self.frames:
            return steps
        span = (self.frames - 1) * self.every + 1
        rng = np.random.default_rng([self.episode_seed(number), 1])
        return int(rng.integers(max(busy - span, 0) + 1)) + np.arange(self.frames) * self.every
