"""Training of a network; after an interruption it continues as if there had been none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.learning.checkpoint import check_shapes, read_state, write_state
from embodiedreamer_gym.learning.optimisation import Optimisation
from embodiedreamer_gym.learning.processes import Processes

CHECKPOINT = "checkpoint.pt"
SAVED_EVERY = 250  # steps


@dataclass(frozen=True)
class TrainingSettings:
    """How a network is trained."""

    steps: int = 4000
    """Steps of the optimiser."""
    batch: int = 32
    """Examples per step."""
    learning_rate: float = 1e-3
    """Peak learning rate of AdamW, reached by a warm-up and followed by a cosine decay."""
    weight_decay: float = 1e-4
    """Weight decay of AdamW."""
    clip: float = 1.0
    """Largest norm of the gradient."""
    average: float = 0.99
    """Decay of the running average of the weights: the share that each step keeps."""
    seed: int = 0
    """Seed of all random draws."""

    def check(self, error: type[EmbodieDreamerError], **shares: float) -> None:
        """Check the values; shares: further values, by name, that must be between 0 and 1.

        Raises: `error` for the first value out of range.
        """
        for name in ("steps", "batch"):
            if getattr(self, name) < 1:
                raise error(f"{name} is {getattr(self, name)}, but must be at least 1.")
        for name, share in (("average", self.average), *shares.items()):
            if not 0 <= share <= 1:
                raise error(f"{name} is {share}, but must be a share between 0 and 1.")
        if not 0 < self.learning_rate < math.inf:
            raise error(f"the learning rate is {self.learning_rate}, but must be a number above 0.")
        if self.seed < 0:
            raise error(f"seed is {self.seed}, but must be at least 0.")


class Training:
    """Training of a network: `run` continues from the current step; `save` and `load` keep everything that this needs.

    network: the network to train.
    settings: training settings.
    error: class of the errors that are raised.
    processes: processes that train it together; each has its own share of a step's batch.
    options: of AdamW.
    Subclasses define `loss`, whose random draws must depend on seed and step alone, and may define `identity`, `state`,
    `restore` and `migrate`.
    """

    def __init__(
        self, network: nn.Module, settings: TrainingSettings, error: type[EmbodieDreamerError],
        processes: Processes | None = None, **options: Any,
    ) -> None:  # fmt: skip
        self.network, self.config, self.error, self.step = network, settings, error, 0
        self.processes = processes or Processes()
        self.optimisation = Optimisation(
            network.parameters(), settings.steps, settings.learning_rate, clip=settings.clip,
            weight_decay=settings.weight_decay, processes=self.processes, **options,
        )  # fmt: skip
        self.averaged: dict[str, Tensor] = {}
        self.reset_average()

    def loss(self, step: int) -> dict[str, Tensor]:
        """The loss of a step's batch under "loss", and other numbers to report by name."""
        raise NotImplementedError

    def identity(self) -> dict[str, Any]:
        """Values, by name, that a checkpoint must have too: they identify the network and the data."""
        return {}

    def state(self) -> dict[str, Any]:
        """Further state that is needed to continue."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned.

        Raises: LookupError, TypeError, ValueError, AttributeError or RuntimeError for an invalid state.
        """

    def migrate(self, state: dict[str, Any]) -> dict[str, Any]:
        """Convert a checkpoint of an earlier version to the current names."""
        return state

    def reset_average(self) -> None:
        """Restart the running average at the network's weights."""
        self.averaged = {name: value.detach().clone() for name, value in self.network.state_dict().items()}

    def run(
        self, until: int | None = None, report: Callable[[dict[str, float]], None] | None = None
    ) -> dict[str, float]:
        """Train up to a step, by default the last one.

        report: is called with the values of each step: step, loss, gradient (norm), learning_rate and those of `loss`.
        Returns the values of the last step.
        Raises: `error` if the loss is not finite.
        """
        row: dict[str, float] = {}
        self.network.train()
        for step in range(self.step, self.config.steps if until is None else min(until, self.config.steps)):
            row = self.advance(step)
            self.step = step + 1
            if report is not None:
                report(row)
        return row

    def advance(self, step: int) -> dict[str, float]:
        """One step of the optimiser."""
        numbers = self.loss(step)
        if not bool(torch.isfinite(self.processes.mean(numbers["loss"].detach()))):
            raise self.error(
                f"the loss is not finite at step {step}; lower the learning rate ({self.config.learning_rate:g})."
            )
        made = self.optimisation.minimise(numbers["loss"], step)
        keep = min(self.config.average, (step + 1) / (step + 10))
        with torch.no_grad():
            for name, value in self.network.state_dict().items():
                old = self.averaged[name]
                self.averaged[name] = old.lerp_(value, 1.0 - keep) if value.is_floating_point() else value.clone()
        return {"step": step + 1, **{name: float(one.detach()) for name, one in numbers.items()}, **made}

    def save(self, path: str | Path) -> None:
        """Write weights, averages, optimiser and step."""
        own = {"training": asdict(self.config), **self.identity(), **self.state()}
        weights = {"averaged": self.averaged, "network": self.network.state_dict()}
        own |= {"step": self.step, "optimiser": self.optimisation.adamw.state_dict()}
        write_state({**own, **weights}, path, self.error)

    def load(self, path: str | Path) -> None:
        """Continue from what `save` wrote.

        Raises: `error` if it has other settings, another network or other data, or is damaged.
        """
        damaged = self.error(f"{path} is not a training checkpoint; it is damaged or another kind of file.")
        state = self.migrate(read_state(path, damaged))
        if not isinstance(state.get("training"), dict):
            raise damaged
        stored = {**state, "training": {**asdict(type(self.config)()), **state["training"]}}
        for name, own in {"training": asdict(self.config), **self.identity()}.items():
            if stored.get(name) != own:
                what = "settings" if name == "training" else name
                raise self.error(
                    f"{path} belongs to a training with other {what}; give another folder, or the same {what}."
                )
        try:
            weights, step = self.network.state_dict(), int(state["step"])
            for key in ("averaged", "network"):
                check_shapes(state[key], weights)
            if not 0 <= step <= self.config.steps:
                raise ValueError(f"step {step}")
            self.optimisation.load(state["optimiser"])
            self.restore(state)
        except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise damaged from error
        self.network.load_state_dict(state["network"])
        self.averaged = {name: state["averaged"][name].to(value.device) for name, value in weights.items()}
        self.step = step


def train_in_folder(
    training: Training, folder: str | Path, report: Callable[[dict[str, float]], None] | None = None,
    saved: Callable[[], object] | None = None,
) -> None:  # fmt: skip
    """Train to the last step; every SAVED_EVERY steps a checkpoint is written into the folder.

    report: is called with the values of each step.
    saved: is called after each checkpoint.
    """
    while training.step < training.config.steps:
        training.run(training.step - training.step % SAVED_EVERY + SAVED_EVERY, report)
        if training.processes.first:
            training.save(Path(folder) / CHECKPOINT)
        if saved is not None:
            saved()
    training.processes.wait()
