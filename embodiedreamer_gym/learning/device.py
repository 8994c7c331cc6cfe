"""Devices by name."""

from __future__ import annotations

import torch

from embodiedreamer_gym.errors import EmbodieDreamerError


def find_device(name: str, error: type[EmbodieDreamerError] = EmbodieDreamerError) -> torch.device:
    """The device "cpu", "cuda", "cuda:1", "mps", ...; "auto": the accelerator that PyTorch finds, else the CPU.

    Raises: `error` for a device that is unknown or not available here.
    """
    found = torch.accelerator.current_accelerator() if torch.accelerator.is_available() else None
    if name == "auto":
        return found or torch.device("cpu")
    try:
        device = torch.device(name)
        if device.type != "meta":  # meta tensors hold no data
            torch.empty(1, device=device).cpu()
            return device
    except (RuntimeError, AssertionError, NotImplementedError, ValueError):  # AssertionError: torch built without it
        pass
    raise error(f"device {name!r} is not available here; use auto, cpu{'' if found is None else f' or {found.type}'}.")
