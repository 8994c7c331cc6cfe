"""Settings of the pipelines, in a module that imports quickly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.pipelines import FRAME_INTERVAL

PREFERENCES = "preferences"  # the method that compares; the others clone
RENAMED = {"dream": "vis_aligner", "rate": "learning_rate"}  # settings of version 0.1


@dataclass(frozen=True)
class EvaluationSettings:
    """What is played to evaluate a policy."""

    policy: str
    """A folder (of `policy train`, or LeRobot's ACT), or package.module:function."""
    task: str
    """Such as PutCupOnMat-v0."""
    episodes: int = 50
    """To play."""
    seed: int = 100_000
    """Of the first episode; the next ones count on."""
    execute: int | None = None
    """Actions executed of each chunk (default: all)."""
    ensemble: Annotated[float, (-1e3, 1e3)] | None = None
    """Decay of temporal ensembling, the paper's k, there 0.01 (default: none)."""
    robot: str = "aloha"
    """JSON file or built-in robot (`embodiedreamer robots`)."""
    tracking: str | None = None
    """Send commands through this calibrated model: JSON file or built-in robot (default: only for policies that give positions)."""
    tracking_mode: Literal["feed_forward", "trim", "both"] = "both"
    """What --tracking sends: what the model needs, the encoders' integral, or both."""
    learnt_on: str = "aloha"
    """Robot whose commands the policy learnt, for --tracking: JSON file or built-in robot."""
    size: str | None = None
    """Width x height of the pictures (default: as in the policy's training, or 128x96)."""
    vis_aligner: str | None = None
    """Observe through this video model (default: lean)."""
    bank: str = "lab"
    """Photos from which the video model starts: lab, or a file."""
    every: int | None = None
    """Show the video model's picture after every n-th action and the last of a chunk (default 5; with --video 1)."""
    jobs: int = 1
    """Processes."""
    video: Path | None = None
    """Write the camera pictures, a video for each episode."""


@dataclass(frozen=True)
class StudySettings:
    """What a preference study does.

    Raises: PolicyError for what could only fail after the rollouts.
    """

    policy: str
    """A folder, or package.module:function."""
    task: str
    """Such as PutCupOnMat-v0."""
    evaluations: int = 100
    """Episodes after each cycle."""
    robot: str = "aloha"
    """JSON file or built-in robot (`embodiedreamer robots`)."""
    vis_aligner: str | None = None
    """Observe through this video model (default: lean)."""
    bank: str = "lab"
    """Photos from which the video model starts: lab, or a file."""
    every: int = FRAME_INTERVAL
    """Show the video model's picture after every n-th action and the last of a chunk."""
    execute: int | None = None
    """Actions executed of each chunk (default: all)."""
    envs: int = 1
    """Episodes at once in each process; the last digits of the results depend on it."""
    jobs: int = 1
    """Processes."""
    seed: int = 0
    """Of the random numbers."""
    starts: int = 100
    """Rollouts: starts of a cycle."""
    tries: int = 4
    """Rollouts: from each start."""
    noise: float = 0.1
    """Rollouts: standard deviation of exploration, normalised."""
    per: Literal["chunk", "step"] = "chunk"
    """Rollouts: one noise per chunk or step."""
    metric: str = "remaining"
    """Of the ranking: remaining (distance to the object, then of the object to its goal), object_distance, or distance
    (end effector to target, the paper's)."""
    pairing: Literal["same_start", "global_rank"] = "same_start"
    """Of rollouts."""
    top: int | None = None
    """Pairs, or trajectories, at most (the paper's 25)."""
    margin: float = 0.005
    """Pairs nearer to a tie are left out, m."""
    method: Literal["preferences", "best_of", "top", "rwr"] = "preferences"
    """Learn from preferences; or clone the best_of each start, the top of all, or all by reward (rwr)."""
    variant: str = "clipped+dpop"
    """Of the loss: paper, ipo, nll, dpop, clipped, clipped+dpop."""
    beta: float = 0.1
    """Of the preference loss."""
    sigma: Annotated[float, (0.0, 1e9, True)] = 4.0
    """Of the likelihood; the paper's is 1."""
    epochs: int = 80
    """Of a cycle."""
    batch: int | None = None
    """Pairs of a step (default 25), or chunks to clone (256)."""
    learning_rate: Annotated[float, (0.0, 1e3, True)] | None = None
    """Of Adam (default 3e-5 for preferences, 1e-4 to clone)."""
    fall: float = 5.0
    """Stop where the winners' log-likelihood falls by more, nats; 0: never."""

    def __post_init__(self) -> None:
        from embodiedreamer_gym.policies.preferences import METRICS

        for name, value in (("noise", self.noise), ("margin", self.margin)):
            if not 0 <= value < math.inf:
                raise PolicyError(f"{name} is {value}, but must be a number of at least 0.")
        if self.seed < 0:
            raise PolicyError(f"seed is {self.seed}, but must be at least 0.")
        if self.metric not in METRICS:
            raise PolicyError(f"metric '{self.metric}' is none of {', '.join(METRICS)}.")
        if self.tries == 1 and self.pairing == "same_start" and self.method == PREFERENCES:
            raise PolicyError("every start is tried once, which makes no pair; give at least 2 tries, or global_rank.")
