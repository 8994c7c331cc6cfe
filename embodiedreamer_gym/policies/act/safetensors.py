"""Reads the safetensors format: a length, a JSON header, raw numbers. No code is run and nothing is written.

Source: github.com/huggingface/safetensors, README.md, "Format".
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError

LONGEST = 100_000_000  # bytes of a header, the format's own limit
TYPES = {
    "F64": torch.float64, "F32": torch.float32, "F16": torch.float16, "BF16": torch.bfloat16,
    "I64": torch.int64, "I32": torch.int32, "I16": torch.int16, "I8": torch.int8, "U8": torch.uint8, "BOOL": torch.bool,
}  # fmt: skip


def read_safetensors(path: str | Path) -> dict[str, torch.Tensor]:
    """Tensors by name.

    Raises: PolicyError where the file is missing, cut off or of another format.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            length = int.from_bytes(file.read(8), "little")
            if not 2 <= length <= min(LONGEST, size - 8):
                raise PolicyError(f"{path} is no safetensors file, or cut off.")
            header = json.loads(file.read(length))
        data = np.memmap(path, np.uint8, "r", 8 + length) if size > 8 + length else np.empty(0, np.uint8)
        return {name: _tensor(entry, data) for name, entry in header.items() if name != "__metadata__"}
    except PolicyError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, RecursionError) as error:
        raise PolicyError(f"{path} cannot be read as safetensors: {error}.") from error


def _tensor(entry: dict[str, Any], data: np.ndarray) -> torch.Tensor:
    """A copy of one tensor."""
    (start, stop), kind = entry["data_offsets"], TYPES[entry["dtype"]]
    shape = [int(side) for side in entry["shape"]]
    count = int(np.prod(shape, dtype=np.int64))
    if not 0 <= start <= stop <= len(data) or min(shape, default=0) < 0 or stop - start != count * kind.itemsize:
        raise ValueError("a tensor lies outside the file, or is not as long as its shape says")
    if not count:
        return torch.empty(shape, dtype=kind)
    return torch.frombuffer(bytearray(data[start:stop]), dtype=kind).reshape(shape)
