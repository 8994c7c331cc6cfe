"""Weights as safetensors: what is read, and what is refused in one sentence."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act.lerobot import read_safetensors

NAMES = {torch.float32: "F32", torch.float16: "F16", torch.int64: "I64"}


def write(path: Path, tensors: dict[str, torch.Tensor], change: dict | None = None) -> Path:
    """Write the format by its description."""
    header, data = {"__metadata__": {"format": "pt"}}, b""
    for name, value in tensors.items():
        raw = value.contiguous().numpy().tobytes()
        offsets = [len(data), len(data) + len(raw)]
        header[name] = {"dtype": NAMES[value.dtype], "shape": list(value.shape), "data_offsets": offsets} | (
            change or {}
        )
        data += raw
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + data)
    return path


def test_what_was_written_is_read(tmp_path: Path) -> None:
    tensors = {"a": torch.arange(6.0).reshape(2, 3), "b.c": torch.tensor([1.5, -2], dtype=torch.float16),
               "one": torch.tensor(7), "none": torch.empty(0, 3)}  # fmt: skip
    found = read_safetensors(write(tmp_path / "x.safetensors", tensors))
    assert set(found) == set(tensors)
    for name, value in tensors.items():
        assert torch.equal(found[name], value) and found[name].dtype == value.dtype
    found["a"] += 1.0  # a copy, not the file
    assert read_safetensors(tmp_path / "x.safetensors")["a"][0, 0] == 0


def test_the_librarys_files_are_read(tmp_path: Path) -> None:
    library = pytest.importorskip("safetensors.torch", reason="the safetensors library is not installed")
    tensors = {"a": torch.randn(3, 4, generator=torch.Generator().manual_seed(0)).bfloat16(), "b": torch.tensor([True])}
    library.save_file(tensors, tmp_path / "x.safetensors")
    found = read_safetensors(tmp_path / "x.safetensors")
    assert all(torch.equal(found[name], value) for name, value in tensors.items())


@pytest.mark.parametrize(
    "change",
    [{"data_offsets": [0, 999]}, {"data_offsets": [-4, 4]}, {"shape": [3]}, {"dtype": "F99"}, {"shape": [-1, -2]}],
)
def test_a_header_that_lies_is_refused(tmp_path: Path, change: dict) -> None:
    path = write(tmp_path / "x.safetensors", {"a": torch.zeros(2)}, change)
    with pytest.raises(PolicyError, match="cannot be read as safetensors"):
        read_safetensors(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"
    with pytest.raises(PolicyError, match="cannot be read"):
        read_safetensors(path)
    for content in (b"", b"short", b"\xff" * 100, (3).to_bytes(8, "little") + b"[1]"):
        path.write_bytes(content)
        with pytest.raises(PolicyError, match="safetensors"):
            read_safetensors(path)
    whole = write(path, {"a": torch.zeros(50)}).read_bytes()
    path.write_bytes(whole[:-4])
    with pytest.raises(PolicyError, match="cannot be read"):
        read_safetensors(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_no_file_of_weights(tmp_path: Path) -> None:
    """It is refused without being opened, which would block."""
    os.mkfifo(tmp_path / "model.safetensors")
    with pytest.raises(PolicyError, match="is not a regular file"):
        read_safetensors(tmp_path / "model.safetensors")
