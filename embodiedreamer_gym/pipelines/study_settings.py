"""Settings of a study of preferences."""

from __future__ import annotations

import math
from dataclasses import dataclass

from embodiedreamer_gym.errors import PolicyError

PREFERENCES = "preferences"  # the method that compares; the others clone
RENAMED = {"dream": "vis_aligner", "rate": "learning_rate"}  # settings of version 0.1


@dataclass(frozen=True)
class StudySettings:
    """What a study does.

    Raises: PolicyError for what could only fail after the rollouts.
    """

    policy: str
    """The policy to improve, as `load_policy` takes it."""
    task: str
    """Id or name of the task."""
    evaluations: int
    """Episodes played after each cycle."""
    robot: str
    """A built-in robot or a model file."""
    vis_aligner: str | None
    """The aligner that generates the pictures; None for the simulator's pictures."""
    bank: str
    """Photos that the aligner starts from: `lab`, or a file."""
    every: int
    """Actions from one generated picture to the next."""
    execute: int | None
    """Actions executed of each chunk; None for all."""
    envs: int
    """Episodes at once in each process."""
    jobs: int
    """Processes."""
    seed: int
    """Seed of all that is drawn."""
    starts: int
    """Starts of a cycle."""
    tries: int
    """Rollouts from each start."""
    noise: float
    """Standard deviation of the exploration noise, in normalised actions."""
    per: str
    """What gets one draw of the noise: `chunk` or `step`."""
    metric: str
    """What ranks trajectories, a name in `METRICS`."""
    pairing: str
    """How pairs are formed: `same_start` or `global_rank`."""
    top: int | None
    """Pairs or trajectories at most; None for the default of the method."""
    margin: float
    """Difference of the metric up to which a pair is left out, m."""
    method: str
    """`preferences`, or cloning of `best_of`, `top` or `rwr`."""
    variant: str
    """Variant of the preference loss, a name in `VARIANTS`."""
    beta: float
    """Weight of a pair in the preference loss."""
    sigma: float
    """Standard deviation of the likelihood, in normalised actions."""
    epochs: int
    """Epochs of a cycle."""
    batch: int | None
    """Pairs (25) or chunks to clone (256) of a step; None for these defaults."""
    learning_rate: float | None
    """Learning rate of Adam; None for LEARNING_RATE, or CLONING_LEARNING_RATE."""
    fall: float
    """Nats by which the winners' likelihood may fall before the guard stops; 0 for no guard."""

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
