"""Fine-tuning on pairs of trajectories: epochs of Adam, with a guard."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.deprecation import renamed_arguments
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.learning.epochs import run_epochs
from embodiedreamer_gym.policies.preferences.guard import FALL, Guard, warn_if_still
from embodiedreamer_gym.policies.preferences.likelihood import (
    ChunkNetwork,
    Chunks,
    chunk_batches,
    likelihood_of_all,
    log_likelihood,
    squared_errors,
)
from embodiedreamer_gym.policies.preferences.losses import LossConfig, tpo_loss
from embodiedreamer_gym.policies.preferences.preference_set import PreferenceSet


@renamed_arguments(rate="learning_rate")
@dataclass(frozen=True)
class TuningConfig:
    """How a policy is fine-tuned on pairs.

    Raises: PolicyError for numbers out of range.
    """

    loss: LossConfig = field(default_factory=LossConfig)
    """Variant of the loss and its constants."""
    sigma: float = 1.0
    """Standard deviation of the Gaussian likelihood, normalised units (the paper's is 1)."""
    epochs: int = 80
    """Epochs over all pairs (the paper's 80)."""
    batch: int = 25
    """Pairs per step."""
    learning_rate: float = 1e-5
    """Learning rate of Adam."""
    fall: float | None = FALL
    """Nats by which the winners may fall below the reference before the guard stops; None for no guard."""
    rows: int = 512
    """Chunks that go through the network at once (memory)."""
    seed: int = 0
    """Seed of the order of the pairs."""

    def __post_init__(self) -> None:
        for name in ("epochs", "batch", "rows"):
            if getattr(self, name) < 1:
                raise PolicyError(f"{name} is {getattr(self, name)}, but must be at least 1.")
        for name in ("sigma", "learning_rate", "fall"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise PolicyError(f"{name} is {value}, but must be above 0.")


@dataclass(frozen=True)
class Tuned:
    """Results of fine-tuning, epoch by epoch.

    loss, winner, loser: mean loss, and mean log-likelihoods minus the reference's, after each epoch (the first entry is
    before the first one); gradient: norm at the start; error: largest norm of a^ - a over a chunk at the start,
    normalised; stopped: the epoch that the guard undid, or None.
    """

    loss: tuple[float, ...]
    winner: tuple[float, ...]
    loser: tuple[float, ...]
    gradient: float
    error: float
    stopped: int | None = None


class Pairs:
    """The pairs of a set as tensors, and their log-likelihood under the reference, the network at the start."""

    def __init__(self, network: ChunkNetwork, pairs: PreferenceSet, config: TuningConfig) -> None:
        self.network, self.config, self.count = network, config, len(pairs)
        self.chunks = Chunks.of((*pairs.winners, *pairs.losers), network)  # winner i has number i, its loser count + i
        self.reference = self.likelihood()

    def likelihood(self) -> torch.Tensor:
        """Log-likelihood (2 n,) of all winners, then all losers, without gradients."""
        return likelihood_of_all(self.network, self.chunks, self.config.sigma, self.config.rows)

    def loss(self, likelihood: torch.Tensor, chosen: torch.Tensor) -> torch.Tensor:
        """Loss of some pairs (n,), given the log-likelihoods (2 n,) of their winners and losers."""
        winner, loser = likelihood.split(len(chosen))
        return tpo_loss(winner, loser, self.reference[chosen], self.reference[self.count + chosen], self.config.loss)

    def backward(self, chosen: torch.Tensor) -> None:
        """Add the gradient of the loss of some pairs (n,), at most `rows` chunks at a time.

        The loss depends on the weights only through the likelihoods, so its derivatives by these are computed first.
        """
        part, config = self.chunks.part(torch.cat([chosen, self.count + chosen])), self.config
        if len(part) <= config.rows:
            self.loss(log_likelihood(self.network, part, config.sigma), chosen).backward()
            return
        likelihood = likelihood_of_all(self.network, part, config.sigma, config.rows)
        counts = torch.autograd.grad(self.loss(likelihood.requires_grad_(), chosen), likelihood)[0]
        for rows in chunk_batches(part, config.rows):
            (log_likelihood(self.network, part.rows(rows), config.sigma) * counts).sum().backward()

    def start(self) -> tuple[float, float]:
        """Norm of the loss's gradient over the pairs of one step, and the largest norm of a^ - a over a chunk."""
        chosen = torch.arange(min(self.count, self.config.batch))
        self.network.zero_grad()
        self.backward(chosen)
        norm = sum(float(p.grad.square().sum()) for p in self.network.parameters() if p.grad is not None) ** 0.5
        self.network.zero_grad()
        part = self.chunks.part(torch.cat([chosen, self.count + chosen]))
        with torch.no_grad():
            rows = chunk_batches(part, self.config.rows)
            worst = max(float(squared_errors(self.network, part.rows(r)).max()) for r in rows)
        return norm, worst**0.5

    def state(self) -> tuple[float, float, float]:
        """Mean loss over all pairs, and mean log-likelihoods of winners and losers minus the reference's."""
        likelihood = self.likelihood()
        winner, loser = (likelihood - self.reference).split(self.count)
        return float(self.loss(likelihood, torch.arange(self.count))), float(winner.mean()), float(loser.mean())


def fine_tune(
    network: ChunkNetwork,
    pairs: PreferenceSet,
    config: TuningConfig | None = None,
    progress: ProgressCallback | None = None,
) -> Tuned:
    """Fine-tune a network in place on a set of pairs; the reference is the network as given.

    Dropout is off, so that the ratio to the reference depends on the weights alone. The guard checks after each epoch.
    Warns: NoGradientWarning if the loss cannot change the network.
    Raises: PolicyError if the set and the network do not fit.
    """
    config = config or TuningConfig()
    network.eval()
    data = Pairs(network, pairs, config)
    gradient, error = data.start()
    warn_if_still(gradient, error)
    guard, states, stopped, shown = Guard(network, config.fall), [data.state()], None, progress_or_silence(progress)
    epochs = run_epochs(
        network.parameters(), data.backward, data.count, epochs=config.epochs, batch=config.batch,
        learning_rate=config.learning_rate, seed=config.seed,
    )  # fmt: skip
    for epoch in epochs:
        states.append(data.state())
        shown("fine-tuning", epoch, config.epochs, winners=f"{states[-1][1]:+.2f} nats")
        if not guard.passes(states[-1][1]):
            stopped = epoch
            break
    loss, winner, loser = zip(*states, strict=True)
    return Tuned(loss, winner, loser, gradient, error, stopped)
