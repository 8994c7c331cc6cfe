"""Nested dictionaries of tensors and plain values in torch files; reading runs no code, and sizes are checked first."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import atomic_file, check_regular

SLACK = 1 << 20  # bytes by which an archive's contents may exceed its file


def write_state(state: Mapping[str, Any], path: str | Path, error: type[EmbodieDreamerError]) -> None:
    """Write a state atomically.

    Raises: `error` if the file cannot be written.
    """
    with atomic_file(path, error) as part, part.open("wb") as file:
        torch.save(dict(state), file)


def read_state(path: str | Path, damaged: Exception) -> dict[str, Any]:
    """Read the dictionary that `write_state` wrote, on the CPU; no code in the file is run.

    Raises: `damaged` if the file is of another kind, is truncated, or would take more memory than its size (compressed
    archives, tensors larger than their storage).
    """
    try:
        check_regular(path)
        with zipfile.ZipFile(path) as archive:  # torch's older format allocates before it reads
            size = sum(entry.file_size for entry in archive.infolist())
        if size > Path(path).stat().st_size + SLACK:
            raise damaged
        state = torch.load(path, weights_only=True, map_location="cpu")
    except Exception as error:  # whatever a damaged or foreign file raises
        raise damaged from error
    if not isinstance(state, dict) or any(one.numel() > _stored(one) for one in tensors(state)):
        raise damaged
    return state


def tensors(state: Any) -> Iterator[Tensor]:
    """All tensors in nested dictionaries, lists and tuples."""
    if isinstance(state, Tensor):
        yield state
    elif isinstance(state, Mapping | list | tuple):
        for one in state.values() if isinstance(state, Mapping) else state:
            yield from tensors(one)


def check_shapes(state: Any, like: Mapping[str, Tensor]) -> None:
    """Check that a state has the same tensors as `like`, by name and shape.

    Raises: ValueError that names the first tensor that differs.
    """
    if not isinstance(state, Mapping):
        raise ValueError("not a dictionary of tensors")
    for name in (*like, *(name for name in state if name not in like)):
        shapes = [tuple(getattr(one.get(name), "shape", ("missing",))) for one in (state, like)]
        if shapes[0] != shapes[1]:
            raise ValueError(f"{name} has shape {shapes[0]}, not {shapes[1]}")


def _stored(tensor: Tensor) -> int:
    """Number of elements in a tensor's storage."""
    return tensor.untyped_storage().nbytes() // max(tensor.element_size(), 1)
