"""Epochs of Adam over examples in random order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import torch
from torch import Tensor, nn


def run_epochs(
    parameters: Iterable[nn.Parameter], backward: Callable[[Tensor], None], examples: int, *, epochs: int, batch: int,
    learning_rate: float, seed: int,
) -> Iterator[int]:  # fmt: skip
    """Train for some epochs, and yield the number of each, from 1, when it ends.

    parameters: those that require a gradient are trained.
    backward: adds the gradient of the loss of some examples (n,), given by number.
    examples: number of examples.
    batch: examples per step.
    seed: of the order.
    """
    optimiser = torch.optim.Adam([one for one in parameters if one.requires_grad], learning_rate)
    generator = torch.Generator().manual_seed(seed)
    for epoch in range(1, epochs + 1):
        for chosen in torch.randperm(examples, generator=generator).split(batch):
            optimiser.zero_grad()
            backward(chosen)
            optimiser.step()
        yield epoch
