"""Training of an ACT network on episodes; an interrupted training continues as if it had not been interrupted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.learning.training import CHECKPOINT, Training, TrainingSettings, train_in_folder
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.curves import Curves
from embodiedreamer_gym.policies.act.mirror import MirroredEpisodes
from embodiedreamer_gym.policies.act.network import Act, current_names
from embodiedreamer_gym.policies.act.policy import ActPolicy
from embodiedreamer_gym.policies.act.samples import Samples
from embodiedreamer_gym.policies.act.statistics import Statistics
from embodiedreamer_gym.recordings.episodes import EpisodeSet

SHOWN_EVERY = 10  # steps
RENAMED = {"rate": "learning_rate", "asked": "chunk_start_share"}  # settings of version 0.1


@renamed_arguments(**RENAMED)
@dataclass(frozen=True)
class TrainingConfig(TrainingSettings):
    """How an ACT network is trained.

    Raises: PolicyError for numbers out of range.
    """

    kl: float = 10.0
    """Weight of the CVAE's KL divergence."""
    mirror: tuple[int, ...] = ()
    """Signed joint numbers with which `train` adds mirror images, see `MirroredEpisodes`; () for none."""
    chunk_start_share: float = 0.7
    """Share of examples near chunk starts, where a policy that plays whole chunks predicts; the rest are anywhere."""
    rest: bool = True
    """Whether an episode's last action is repeated and learnt past its end; if not, the loss ignores these steps."""

    def __post_init__(self) -> None:
        """Check the values."""
        self.check(PolicyError, chunk_start_share=self.chunk_start_share)

    @staticmethod
    def usual(config: ActConfig, **settings: Any) -> TrainingConfig:
        """Settings, with defaults for None or missing ones; kind `object_pose` takes more steps, which are cheaper."""
        wanted = {"steps": 8000, "batch": 64} if config.kind == "object_pose" else {}
        return TrainingConfig(**{**wanted, **{name: value for name, value in settings.items() if value is not None}})


class ActTraining(Training):
    """Training of an ACT network.

    samples: training data.
    config: training settings.
    network: by default a new one with the samples' configuration.
    """

    network: Act
    config: TrainingConfig

    def __init__(self, samples: Samples, config: TrainingConfig, network: Act | None = None) -> None:
        self.samples = samples
        if network is None:
            measured = Statistics.measure(samples.states, samples.actions, len(samples.config.cameras))
            network = Act(samples.config, measured, config.seed)
        super().__init__(network, config, PolicyError, fused=True)

    def policy(self) -> ActPolicy:
        """The policy with the averaged weights."""
        network = Act(self.network.config)
        network.load_state_dict(self.averaged)
        return ActPolicy(network.to(self.network.device))

    def learn_object_poses(self, progress: ProgressCallback | None = None) -> None:
        """Train the object pose heads, if there are any, on the masks of the samples."""
        self.network.learn_object_poses(self.samples, self.config.seed, progress)
        self.reset_average()

    def keep_object_poses(self, progress: ProgressCallback | None = None) -> None:
        """Compute the objects' poses in all pictures, if the network uses them and there are steps left."""
        wanted = self.network.object_pose_heads is not None and self.step < self.config.steps
        if wanted and not self.samples.has_object_poses:
            self.samples.keep_object_poses(self.network.object_poses, progress)

    def run(
        self, until: int | None = None, report: Callable[[dict[str, float]], None] | None = None
    ) -> dict[str, float]:
        """Train up to a step, by default the last one; see `Training.run`."""
        self.keep_object_poses()
        return super().run(until, report)

    def loss(self, step: int) -> dict[str, torch.Tensor]:
        """L1 error of normalised actions (see `rest`), the latent's KL divergence (nats), and their weighted sum."""
        network, device = self.network, self.network.device
        rng = np.random.default_rng([self.config.seed, step])
        sample = self.samples.draw(rng, self.config.batch, self.config.chunk_start_share)
        actions = network.normalise(torch.from_numpy(sample.actions).to(device))
        padding = torch.from_numpy(sample.padding).to(device)
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        noise = torch.randn(len(actions), network.config.latent, generator=generator).to(device)
        with torch.random.fork_rng(devices=[]):  # dropout draws from torch's global generator
            torch.manual_seed(int(rng.integers(2**62)))
            predicted, divergence = network(sample.batch, actions, padding, noise)
        error = (predicted - actions).abs().mean(2)
        l1, divergence = (error if self.config.rest else error[~padding]).mean(), divergence.mean()
        return {"loss": l1 + self.config.kl * divergence, "l1": l1, "kl": divergence}

    def identity(self) -> dict[str, Any]:
        """The network's configuration and the episodes' fingerprint."""
        return {"sizes": self.network.config.as_dict(), "episodes": self.samples.fingerprint}

    def migrate(self, state: dict[str, Any]) -> dict[str, Any]:
        """Convert a checkpoint of version 0.1 to the current names."""
        if "config" not in state:
            return state
        settings = {RENAMED.get(name, name): value for name, value in dict(state["training"]).items()}
        weights = {key: current_names(state[key]) for key in ("averaged", "network")}
        return {**state, "training": settings, "sizes": state["config"], **weights}


def train(episodes: EpisodeSet, config: ActConfig, training: TrainingConfig, folder: str | Path,
          progress: ProgressCallback | None = None, tell: Callable[[str], None] | None = None, device: str = "cpu") -> ActPolicy:  # fmt: skip
    """Train a policy and save it in a folder, from which `ActPolicy.load` reads it; an interrupted training continues.

    tell: is called with messages for the user.
    Writes config.json, weights.pt, checkpoint.pt and curves.csv.
    Raises: PolicyError for episodes that do not fit, or a folder that holds a training with other settings.
    """
    if training.mirror:
        episodes = MirroredEpisodes(episodes, training.mirror, config.cameras)
    run, folder = ActTraining(Samples(episodes, config), training), Path(folder)
    run.network.to(device)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / CHECKPOINT).is_file():
        run.load(folder / CHECKPOINT)
    else:
        run.learn_object_poses(progress)
    run.keep_object_poses(progress)
    curves, shown = Curves(folder, run.step), progress_or_silence(progress)
    if curves.note and tell is not None:
        tell(curves.note)

    def report(row: dict[str, float]) -> None:
        if row["step"] % SHOWN_EVERY == 0 or row["step"] == training.steps:
            curves.add(row)
        shown("training", int(row["step"]), training.steps, loss=f"{row['loss']:.4f}")

    try:
        train_in_folder(run, folder, report, lambda: run.policy().save(folder))
    finally:
        curves.close()
    policy = run.policy()
    policy.save(folder)  # again: the last save may have been interrupted between checkpoint and policy
    return policy
