"""Devices by name."""

from __future__ import annotations

import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.learning.device import find_device


def test_the_cpu_is_always_there_and_auto_finds_something() -> None:
    assert find_device("cpu") == torch.device("cpu")
    assert torch.ones(2, device=find_device("auto")).sum() == 2


@pytest.mark.parametrize("name", ["meta", "cuda:97", "gpu", "", "cpu0"])
def test_what_is_not_available_is_refused_with_what_is(name: str) -> None:
    with pytest.raises(VisionError, match=f"device '{name}' is not available here; use auto, cpu"):
        find_device(name, VisionError)
