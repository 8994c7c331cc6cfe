"""Training on episodes: chunks after true or own references; a running average of the weights; goes on anywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.aligner import Trainable
from embodiedreamer_gym.vis_aligner.bench import with_benches
from embodiedreamer_gym.vis_aligner.clip import OBJECT, Condition, Episode, References

CHECKPOINT = "checkpoint.pt"
SAVED_EVERY = 250  # steps
WARM_UP = 100  # steps up to the peak learning rate
Progress = Callable[[str, int, float], None]


@dataclass(frozen=True)
class TrainingConfig:
    """How a model is trained.

    steps: of the optimiser; batch: clips; rate: peak learning rate; told: share of walks that know their bench and how
    the objects move, the others only what a real clip tells; own: how likely a clip is followed by the next one of its
    episode, with the model's own last frame as reference (1 / (1 - own) clips in a row on average); average: of the
    weights, per step.
    """

    steps: int = 4000
    batch: int = 2
    rate: float = 1e-3
    told: float = 0.7
    own: float = 0.8
    average: float = 0.998
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Walk:
    """Where training is in an episode: its number, the frame the references show; whether bench and objects'
    poses are known; pictures of the model's own, if any.
    """

    episode: int
    at: int
    told: bool
    last: Tensor | None = None
    plate: Tensor | None = None

    def references(self, episodes: Sequence[Episode]) -> References:
        """References of the chunk that follows."""
        one = episodes[self.episode]
        true = one.references(self.at, one.bench if self.told else None).viewed(self._known)
        if self.last is None or self.plate is None:
            return true
        return replace(true, last=self.last.numpy(), plate=self.plate.numpy())

    def condition(self, episodes: Sequence[Episode], frames: int) -> Condition:
        """The condition of the chunk that follows."""
        return self._known(episodes[self.episode].condition.part(self.at + 1, self.at + 1 + frames))

    def _known(self, condition: Condition) -> Condition:
        """A condition as this walk knows it."""
        return condition if self.told else condition.without_parts(OBJECT)


class Training:
    """A model under training: `run` goes on from where it is; `save` and `load` keep all that this takes."""

    def __init__(self, aligner: Trainable, config: TrainingConfig) -> None:
        self.aligner, self.config = aligner, config
        network = aligner.network
        self.averaged = {k: v.detach().clone() for k, v in network.state_dict().items()}
        trained = [p for p in network.parameters() if p.requires_grad]
        self.optimiser = torch.optim.AdamW(trained, config.rate, weight_decay=1e-3)
        self.walks: list[Walk | None] = [None] * config.batch
        self.data: list[int] = []  # lengths of the episodes
        self.step = 0

    def run(self, episodes: Sequence[Episode], progress: Progress | None = None, until: int | None = None) -> None:
        """Train up to a step, by default the last one.

        Raises: VisionError without an episode that is longer than a chunk.
        """
        long = [e for e in episodes if len(e) > self.aligner.chunk]
        if not long:
            raise VisionError(f"no episode is longer than {self.aligner.chunk} frames; record longer ones.")
        if self.step and self.data != [len(e) for e in long]:
            raise VisionError("this training was begun with other episodes; give another folder, or the same episodes.")
        self.data = [len(e) for e in long]
        self.aligner.network.train()
        for step in range(self.step, self.config.steps if until is None else min(until, self.config.steps)):
            loss = self._advance(long, step)
            self.step = step + 1
            if progress is not None:
                progress("training", self.step, loss)

    def finish(self) -> None:
        """Give the network the averaged weights."""
        self.aligner.network.load_state_dict(self.averaged)

    def _advance(self, episodes: Sequence[Episode], step: int) -> float:
        """One step of the optimiser; what is drawn depends on seed and step alone, so that a run can go on anywhere."""
        rng = np.random.default_rng([self.config.seed, step])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        network, k = self.aligner.network, self.aligner.chunk
        for group in self.optimiser.param_groups:
            group["lr"] = self.config.rate * _share(step, self.config.steps)
        walks = [self._begin(episodes, rng) if walk is None else walk for walk in self.walks]
        chosen = [(episodes[w.episode], w.at) for w in walks]
        conditions = [walk.condition(episodes, k) for walk in walks]
        truth = [e.frames[at + 1 : at + 1 + k] for e, at in chosen]
        references = [w.references(episodes) for w in walks]
        loss, made = self.aligner.attempt(references, conditions, truth, generator)
        self.optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        self.optimiser.step()
        self._average(min(self.config.average, (step + 1) / (step + 10)))
        going = [at + 2 * k < len(e) and rng.random() < self.config.own for e, at in chosen]
        self.walks = [None] * len(walks)
        if any(going):
            for i, (frames, condition) in enumerate(zip(made(), conditions, strict=True)):
                after = references[i].after(frames, condition)
                if going[i]:
                    pictures = torch.tensor(after.last), torch.tensor(after.plate)
                    self.walks[i] = Walk(walks[i].episode, walks[i].at + k, walks[i].told, *pictures)
        return float(loss.detach())

    def _begin(self, episodes: Sequence[Episode], rng: np.random.Generator) -> Walk:
        """A walk from a true frame, anywhere: each of all episodes' frames is as likely as any other."""
        starts = np.cumsum([len(e) - self.aligner.chunk for e in episodes])
        drawn = int(rng.integers(starts[-1]))
        number = int(np.searchsorted(starts, drawn, side="right"))
        return Walk(number, int(starts[number]) - 1 - drawn, bool(rng.random() < self.config.told))

    def _average(self, keep: float) -> None:
        with torch.no_grad():
            for name, value in self.aligner.network.state_dict().items():
                old = self.averaged[name]
                self.averaged[name] = old.lerp_(value, 1 - keep) if value.is_floating_point() else value.clone()

    # ---- files -------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write weights, averages, optimiser and step beside, then rename."""
        path = Path(path)
        part = path.with_name(f".{path.name}.part")
        state: dict[str, Any] = {
            "config": asdict(self.config), "step": self.step, "averaged": self.averaged,
            "network": self.aligner.network.state_dict(), "optimiser": self.optimiser.state_dict(), "data": self.data,
            "walks": [None if walk is None else vars(walk) for walk in self.walks],
        }  # fmt: skip
        torch.save(state, part)
        part.replace(path)

    def load(self, path: str | Path) -> None:
        """Go on from what `save` wrote.

        Raises: VisionError where it is of other settings, another model, or damaged.
        """
        try:
            state = torch.load(path, weights_only=True, map_location="cpu")
            config, step = dict(state["config"]), int(state["step"])
            if config == asdict(self.config):
                self.aligner.network.load_state_dict(state["network"])
                self.optimiser.load_state_dict(state["optimiser"])
                self.averaged, self.step, self.data = state["averaged"], step, list(state["data"])
                self.walks = [None if walk is None else Walk(**walk) for walk in state["walks"]]
        except Exception as error:  # whatever a damaged or foreign file raises
            raise VisionError(f"{path} is no checkpoint of this training: damaged, or of another model.") from error
        if config != asdict(self.config):
            raise VisionError(f"{path} was trained with other settings; give another folder, or the same settings.")


def train(aligner: Trainable, episodes: Sequence[Episode], config: TrainingConfig, folder: str | Path | None = None,
          progress: Progress | None = None) -> None:  # fmt: skip
    """Train an aligner in place; with a folder, a checkpoint is kept there, from which an interrupted training goes on.

    Raises: VisionError without long enough episodes, where the checkpoint is of other settings, or the folder cannot be made.
    """
    training, episodes = Training(aligner, config), with_benches(episodes)
    checkpoint = None if folder is None else Path(folder) / CHECKPOINT
    if checkpoint is not None:
        try:
            checkpoint.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise VisionError(f"{folder} cannot be made a folder: {error.strerror}; give another place.") from error
        if checkpoint.is_file():
            training.load(checkpoint)
    while training.step < config.steps:
        training.run(episodes, progress, until=training.step + SAVED_EVERY)
        if checkpoint is not None:
            training.save(checkpoint)
    training.finish()


def _share(step: int, steps: int) -> float:
    """Of the peak learning rate: up over the first steps, down as a cosine."""
    return min(1.0, (step + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * step / max(steps, 1)))
