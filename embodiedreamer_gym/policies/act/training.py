"""Training of an ACT network on episodes; it goes on anywhere as if it had not been interrupted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.curves import Curves
from embodiedreamer_gym.policies.act.mirror import MirroredEpisodes
from embodiedreamer_gym.policies.act.network import Act
from embodiedreamer_gym.policies.act.policy import ActPolicy
from embodiedreamer_gym.policies.act.samples import Episodes, Progress, Samples
from embodiedreamer_gym.policies.act.statistics import Statistics

CHECKPOINT = "checkpoint.pt"
SAVED_EVERY = 250  # steps
SHOWN_EVERY = 10
WARM_UP = 100  # steps up to the peak learning rate


@dataclass(frozen=True)
class TrainingConfig:
    """How a network is trained.

    steps: of the optimiser; batch: starts; rate: peak learning rate of AdamW, down as a cosine; kl: weight of the
    CVAE's divergence; clip: largest norm of a gradient; average: of the weights, per step; mirror: joint numbers with
    signs, by which `train` learns mirror images too, see `MirroredEpisodes`; asked: share of the starts near which a policy is
    asked that plays whole chunks, the others being anywhere; rest: an episode's last action goes on past its end and is
    learnt, so that a robot that is done stays so (else what lies past the end does not count); seed: of all that is drawn.
    """

    steps: int = 4000
    batch: int = 32
    rate: float = 1e-3
    weight_decay: float = 1e-4
    kl: float = 10.0
    clip: float = 1.0
    average: float = 0.99
    mirror: tuple[int, ...] = ()
    asked: float = 0.7
    rest: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        """Check."""
        for name in ("steps", "batch"):
            if getattr(self, name) < 1:
                raise PolicyError(f"{name} is {getattr(self, name)}, but must be at least 1.")
        if not 0 <= self.asked <= 1:
            raise PolicyError(f"asked is {self.asked}, but must be a share between 0 and 1.")
        if not 0 < self.rate < math.inf:
            raise PolicyError(f"the learning rate is {self.rate}, but must be a number above 0.")
        if self.seed < 0:
            raise PolicyError(f"seed is {self.seed}, but must be at least 0.")

    @staticmethod
    def usual(config: ActConfig, **settings: Any) -> TrainingConfig:
        """Steps and batch that a network wants which are not said, by whether it has eyes; they make steps cheap."""
        wanted = {"steps": 8000, "batch": 64} if config.objects else {}
        return TrainingConfig(**{**wanted, **{name: value for name, value in settings.items() if value is not None}})


class Training:
    """A network under training: `run` goes on from where it is; `save` and `load` keep all that this takes."""

    def __init__(self, samples: Samples, config: TrainingConfig, network: Act | None = None) -> None:
        self.samples, self.config = samples, config
        if network is None:
            measured = Statistics.measure(samples.states, samples.actions, len(samples.config.cameras))
            network = Act(samples.config, measured, config.seed)
        self.network = network
        self.averaged = {k: v.detach().clone() for k, v in network.state_dict().items()}
        self.optimiser = torch.optim.AdamW(
            network.parameters(), config.rate, weight_decay=config.weight_decay, fused=True
        )
        self.step = 0

    @property
    def device(self) -> torch.device:
        """Where the network is."""
        return self.network.device

    def run(
        self, until: int | None = None, curves: Curves | None = None, progress: Progress | None = None
    ) -> dict[str, float]:
        """Train up to a step, by default the last one; the numbers of the last step.

        Raises: PolicyError where the loss is not finite any more.
        """
        row: dict[str, float] = {}
        if self.network.eyes is not None and not self.samples.told and self.step < self.config.steps:
            self.samples.tell(self.network.told, progress)
        self.network.train()
        for step in range(self.step, self.config.steps if until is None else min(until, self.config.steps)):
            row = self._advance(step)
            self.step = step + 1
            if curves is not None and (self.step % SHOWN_EVERY == 0 or self.step == self.config.steps):
                curves.add(row)
            if progress is not None:
                progress("training", self.step, self.config.steps, f"loss {row['loss']:.4f}")
        return row

    def policy(self) -> ActPolicy:
        """The policy with the averaged weights."""
        network = Act(self.network.config)
        network.load_state_dict(self.averaged)
        return ActPolicy(network.to(self.device))

    def loss(self, step: int) -> tuple[torch.Tensor, torch.Tensor]:
        """L1 of normalised actions over what is no padding, and the latent's divergence (nats), of a step's batch.

        What is drawn depends on seed and step alone, so that a training can go on anywhere.
        """
        rng = np.random.default_rng([self.config.seed, step])
        sample = self.samples.draw(rng, self.config.batch, self.config.asked)
        actions = self.network.normalise(torch.from_numpy(sample.actions).to(self.device))
        padding = torch.from_numpy(sample.padding).to(self.device)
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        noise = torch.randn(len(actions), self.network.config.latent, generator=generator).to(self.device)
        with torch.random.fork_rng(devices=[]):  # dropout draws from the module's generator
            torch.manual_seed(int(rng.integers(2**62)))
            predicted, divergence = self.network(sample.batch, actions, padding, noise)
        off = (predicted - actions).abs().mean(2)
        return (off if self.config.rest else off[~padding]).mean(), divergence.mean()

    def _advance(self, step: int) -> dict[str, float]:
        """One step of the optimiser."""
        rate = self.config.rate * _share(step, self.config.steps)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        l1, divergence = self.loss(step)
        loss = l1 + self.config.kl * divergence
        if not bool(torch.isfinite(loss)):
            raise PolicyError(f"the loss is not finite at step {step}; lower the learning rate ({self.config.rate:g}).")
        self.optimiser.zero_grad()
        loss.backward()
        gradient = nn.utils.clip_grad_norm_(self.network.parameters(), self.config.clip)
        self.optimiser.step()
        keep = min(self.config.average, (step + 1) / (step + 10))
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                self.averaged[name].lerp_(value, 1.0 - keep)
        return {"step": step + 1, "loss": float(loss.detach()), "l1": float(l1.detach()), "kl": float(divergence.detach()),
                "gradient": float(gradient), "rate": rate}  # fmt: skip

    # ---- files -------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write weights, averages, optimiser and step beside, then rename."""
        path = Path(path)
        part = path.with_name(f".{path.name}.part")
        state: dict[str, Any] = {
            "training": asdict(self.config), "config": self.network.config.as_dict(), "step": self.step,
            "episodes": self.samples.fingerprint, "averaged": self.averaged, "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
        }  # fmt: skip
        torch.save(state, part)
        part.replace(path)

    def load(self, path: str | Path) -> None:
        """Go on from what `save` wrote.

        Raises: PolicyError where it is of other settings, other episodes, another network, or damaged.
        """
        try:
            state = torch.load(path, weights_only=True, map_location="cpu")
            found = dict(state["training"]), dict(state["config"]), list(state["episodes"]), int(state["step"])
        except Exception as error:  # whatever a damaged or foreign file raises
            raise PolicyError(f"{path} is no checkpoint of a training: damaged, or another file.") from error
        own = (asdict(self.config), self.network.config.as_dict(), self.samples.fingerprint)
        for what, there, here in zip(("settings", "sizes", "episodes"), found, own, strict=False):
            if there != here:
                raise PolicyError(
                    f"{path} is of a training with other {what}; give another folder, or the same {what}."
                )
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.averaged, self.step = {k: v.to(self.device) for k, v in state["averaged"].items()}, found[3]


def train(episodes: Episodes, config: ActConfig, training: TrainingConfig, folder: str | Path,
          progress: Progress | None = None, tell: Callable[[str], None] | None = None, device: str = "cpu") -> ActPolicy:  # fmt: skip
    """Train a policy into a folder, where an interrupted training goes on; `ActPolicy.load` reads it.

    tell: hears what the user should know. Writes config.json, weights.pt, checkpoint.pt and curves.csv.
    Raises: PolicyError for episodes that do not fit, or a folder with a training of other settings.
    """
    if training.mirror:
        episodes = MirroredEpisodes(episodes, training.mirror, config.cameras)
    run, folder = Training(Samples(episodes, config), training), Path(folder)
    run.network.to(device)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / CHECKPOINT).is_file():
        run.load(folder / CHECKPOINT)
    else:
        run.network.look(run.samples, training.seed, progress)
        run.averaged = {name: value.detach().clone() for name, value in run.network.state_dict().items()}
    curves = Curves(folder, run.step)
    if curves.said and tell is not None:
        tell(curves.said)
    try:
        while run.step < training.steps:
            run.run(run.step - run.step % SAVED_EVERY + SAVED_EVERY, curves, progress)
            run.save(folder / CHECKPOINT)
            run.policy().save(folder)
    finally:
        curves.close()
    policy = run.policy()
    policy.save(folder)  # again: the last time may have been interrupted between the two
    return policy


def _share(step: int, steps: int) -> float:
    """Of the peak learning rate: up over the first steps, down as a cosine."""
    return min(1.0, (step + 1) / WARM_UP) * 0.5 * (1.0 + math.cos(math.pi * step / steps))
