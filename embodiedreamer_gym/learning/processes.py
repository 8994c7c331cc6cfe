"""Several processes that train one network, each on its own GPU, as `accelerate launch` starts them."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from embodiedreamer_gym.errors import EmbodieDreamerError, MissingExtraError
from embodiedreamer_gym.learning.device import find_device


@dataclass(frozen=True)
class Processes:
    """This process among those of a training; the only one, unless more were started.

    index: 0 .. count - 1; device: of this process; accelerate: the library, if there are several processes.
    """

    index: int = 0
    count: int = 1
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))
    accelerate: Any = None

    @property
    def first(self) -> bool:
        """Whether this is the process that writes and reports."""
        return self.index == 0

    def mean(self, value: Tensor) -> Tensor:
        """The mean over all processes."""
        return value if self.accelerate is None else self.accelerate.utils.reduce(value, "mean")

    def average_gradients(self, parameters: Iterable[torch.nn.Parameter]) -> None:
        """Replace each gradient by its mean over all processes."""
        if self.accelerate is not None:
            for one in parameters:
                if one.grad is not None:
                    one.grad.copy_(self.mean(one.grad))

    def wait(self) -> None:
        """Wait for the others."""
        if self.accelerate is not None:
            self.accelerate.PartialState().wait_for_everyone()


def find_processes(device: str = "cpu", error: type[EmbodieDreamerError] = EmbodieDreamerError) -> Processes:
    """This process among those that were started together.

    device: name as in `find_device`; with several processes, each gets its own device of this kind.
    Raises: `error` for a device that is not available; MissingExtraError for several processes without accelerate.
    """
    where = find_device(device, error)
    if int(os.environ.get("WORLD_SIZE", "1")) < 2:
        return Processes(device=where)
    try:
        accelerate: Any = importlib.import_module("accelerate")
    except ImportError as missing:
        raise MissingExtraError(
            "training in several processes needs accelerate; run: pip install 'embodiedreamer-gym[accelerate]'"
        ) from missing
    state = accelerate.PartialState(cpu=where.type == "cpu")
    return Processes(state.process_index, state.num_processes, state.device, accelerate)
