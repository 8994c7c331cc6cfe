"""AdamW with a warm-up and a cosine decay of the learning rate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

from embodiedreamer_gym.learning.processes import Processes

WARM_UP = 100  # steps up to the peak learning rate


def cosine(step: int, steps: int, warm_up: int = WARM_UP) -> float:
    """Share of the peak learning rate: linear over `warm_up` steps, then half a cosine down to 0 at the last step."""
    return min(1.0, (step + 1) / warm_up) * 0.5 * (1.0 + math.cos(math.pi * step / max(steps, 1)))


class Optimisation:
    """AdamW over parameters for a number of steps.

    parameters: those that require a gradient are trained.
    steps: number of steps, after which the learning rate is 0.
    learning_rate: peak learning rate.
    warm_up: steps up to the peak.
    clip: largest norm of the gradient; None for no clipping.
    processes: gradients are averaged over them.
    options: further arguments of `torch.optim.AdamW`.
    """

    def __init__(
        self, parameters: Iterable[nn.Parameter], steps: int, learning_rate: float, warm_up: int = WARM_UP,
        clip: float | None = None, processes: Processes | None = None, **options: Any,
    ) -> None:  # fmt: skip
        self.parameters = [one for one in parameters if one.requires_grad]
        self.steps, self.learning_rate, self.warm_up, self.clip = steps, learning_rate, warm_up, clip
        self.processes = processes or Processes()
        self.adamw = torch.optim.AdamW(self.parameters, learning_rate, **options)

    def minimise(self, loss: Tensor, step: int) -> dict[str, float]:
        """Take one step; returns the gradient's norm before clipping (0 without clipping) and the learning rate."""
        learning_rate = self.learning_rate * cosine(step, self.steps, self.warm_up)
        for group in self.adamw.param_groups:
            group["lr"] = learning_rate
        self.adamw.zero_grad()
        loss.backward()
        self.processes.average_gradients(self.parameters)
        norm = 0.0 if self.clip is None else float(nn.utils.clip_grad_norm_(self.parameters, self.clip))
        self.adamw.step()
        return {"gradient": norm, "learning_rate": learning_rate}

    def load(self, state: Any) -> None:
        """Load AdamW's state.

        Raises: ValueError, TypeError, KeyError or AttributeError if it belongs to other parameters.
        """
        for number, moments in state["state"].items():
            for name, shape in dict.fromkeys(("exp_avg", "exp_avg_sq"), self.parameters[number].shape).items():
                if moments[name].shape != shape or moments["step"].numel() != 1:
                    raise ValueError(f"{name} of parameter {number} has another shape")
        self.adamw.load_state_dict({"state": state["state"], "param_groups": self.adamw.state_dict()["param_groups"]})
