"""Mutations of arrays, and of files with arrays: HDF5, npz, safetensors, PyTorch and parquet."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np

from benchmarks.fuzzing.texts import VALUES, WORDS, change_json, change_tree

DTYPES = ("f2", "f4", ">f8", "i1", "u1", "i8", "u8", "c16", "?", "S3", "O", "datetime64[s]", "U4")
EXTREMES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0.0, -1.0, 1e9)
HUGE = ((10**9, 14), (10**6, 10**6), (2**31, 2), (10**7, 480, 640, 3), (10**12,), (40_000_000, 14))
RUBBISH_HDF5 = (None, 0, -1, 1e308, np.nan, "", "x", "[]", "[" * 9999, "{}", '{"a": 1}', "nan", np.arange(3), np.zeros((2, 2)), b"\xff\xfe",
                np.array(["a", "b"], "S1"), np.zeros(0), True, 10**18, np.array([1 + 2j]), "1" + "0" * 400)  # fmt: skip


def change_array(array: np.ndarray, rng: Random) -> np.ndarray:
    """Another dtype, another shape, or other values."""
    kind = rng.randrange(9)
    array = np.array(array)
    try:
        if kind == 0:
            return array.astype(rng.choice(DTYPES))
        if kind == 1:
            return array[:-1] if array.ndim else array[None]
        if kind == 2:
            return rng.choice((array[..., :-1], array[..., None], array.T, array.ravel(), array[None], array[:0]))
        if kind == 3:
            return np.concatenate([array, array])
        if kind == 4:
            return np.zeros(rng.choice(((), (0,), (1,), (1, 1), (3, 0), (1, 2, 3, 4, 5), (2000, 2000))))
        out = array.copy()
        if kind == 5 and out.dtype.kind == "f":
            out[...] = rng.choice(EXTREMES)
        elif out.size and out.dtype.kind in "fiub":
            flat, value = out.reshape(-1), rng.choice(EXTREMES)
            with np.errstate(all="ignore"):
                flat[rng.randrange(flat.size)] = value if out.dtype.kind == "f" else 255
        if kind == 8 and out.ndim and len(out) > 1:
            out = out[::-1]
        return out
    except (ValueError, TypeError, OverflowError, IndexError):  # this change does not work for this array
        return np.zeros(0)


# ---- HDF5 ------------------------------------------------------------------------------------------------------


def change_hdf5(path: Path, rng: Random) -> None:
    """Change, drop or replace a dataset, a group or an attribute."""
    with h5py.File(path, "r+", locking=False) as file:
        names: list[str] = []
        file.visit(names.append)
        name = rng.choice(names) if names else "x"
        owner = rng.choice([file, file, file[name]]) if names else file
        if rng.random() < 0.3:
            return _change_attribute(owner, rng)
        node, kind = file[name], rng.randrange(9)
        array = node[()] if isinstance(node, h5py.Dataset) and node.dtype.kind != "O" else np.zeros((3, 2))
        if kind != 8:
            del file[name]
        if kind == 0:
            file.create_group(name)
        elif kind == 1:
            file[name] = h5py.SoftLink(rng.choice((f"/{name}", "/none", "/")))
        elif kind == 2:
            file[name] = h5py.ExternalLink(
                rng.choice((path.name, "none.hdf5", "/dev/null")), rng.choice((name, "/", "x"))
            )
        elif kind == 3:
            shape = rng.choice(HUGE)
            chunks = tuple(min(side, 64) for side in shape)
            file.create_dataset(
                name, shape, rng.choice(("f8", "u1", "f4")), chunks=chunks, compression=rng.choice((None, "gzip"))
            )
        elif kind == 4:
            file.create_dataset(
                name, data=rng.choice(("text", b"bytes", 1.5, np.array(["a", "é"], h5py.string_dtype()), [True, False]))
            )
        elif kind == 5:
            file.create_dataset(name, array.shape, h5py.vlen_dtype(np.dtype("u1")))
        elif kind < 8:
            changed = change_array(array, rng)
            try:
                file[name] = changed
            except TypeError:  # HDF5 lacks this dtype
                file[name] = np.zeros((2, 2), "c16")
        else:
            file.move(
                name, rng.choice(("x", f"{name}2", f"{name}/x" if isinstance(node, h5py.Group) else "observations/x"))
            )


def _change_attribute(owner: Any, rng: Random) -> None:
    known = [
        *owner.attrs,
        "rate",
        "fps",
        "units",
        "joint_names",
        "noise",
        "quantum",
        "command_hold",
        "kind",
        "objects",
        "class_names",
        "demonstration",
    ]
    name = rng.choice(known)
    value = rng.choice(RUBBISH_HDF5)
    if rng.random() < 0.3 and isinstance(owner.attrs.get(name), np.ndarray) and owner.attrs[name].dtype.kind == "f":
        value = change_array(owner.attrs[name], rng)
    try:
        if value is None:
            owner.attrs.pop(name, None)
        else:
            owner.attrs[name] = value
    except (TypeError, ValueError, OSError, OverflowError):  # HDF5 itself refuses it
        owner.attrs[name] = 0


# ---- npz, safetensors, torch, parquet --------------------------------------------------------------------------


def change_npz(path: Path, rng: Random) -> None:
    """Change, drop, rename or pickle an array of an npz file, or claim that it is huge."""
    with np.load(path) as data:
        arrays: dict[str, Any] = {name: data[name] for name in data.files}
    name, kind = rng.choice(sorted(arrays)), rng.randrange(8)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[rng.choice(("x", "é", f"{name}2"))] = arrays.pop(name)
    elif kind == 2:
        arrays[name] = np.array([{"a": 1}, None], object)
    elif kind < 6:
        arrays[name] = change_array(arrays[name], rng)
    np.savez_compressed(path, **arrays)
    if kind >= 6:  # a header that claims more data than there are
        with zipfile.ZipFile(path) as old:
            members = {one: old.read(one) for one in old.namelist()}
        head = io.BytesIO()
        shape = rng.choice((*HUGE, (2**62,), (-1, 3), (0,)))
        np.lib.format.write_array_header_1_0(
            head, {"descr": rng.choice(("|u1", "<f8")), "fortran_order": False, "shape": shape}
        )
        members[f"{name}.npy"] = head.getvalue() + (bytes(10**7) if kind == 7 else b"")
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
            for one, raw in members.items():
                new.writestr(one, raw)


def change_safetensors(path: Path, rng: Random) -> None:
    """Change the header as JSON; the numbers stay."""
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    text = change_json(data[8 : 8 + size].decode(), rng).encode("utf-8", "replace")
    claimed = rng.choice((len(text),) * 5 + (0, 1, 2**63, len(data)))
    path.write_bytes(claimed.to_bytes(8, "little") + text + data[8 + size :])


class Pickled:
    """Create a file when unpickled; no reader may unpickle it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return open, ("unpickled.txt", "w")


def change_torch(path: Path, rng: Random) -> None:
    """Change a node of a saved dictionary (keys, shapes, types); sometimes insert a pickle that runs code."""
    import torch

    tree = torch.load(path, weights_only=True)

    def changed(leaf: Any, rng: Random) -> Any:
        if not isinstance(leaf, torch.Tensor):
            return rng.choice(VALUES)
        kind = rng.randrange(6)
        if kind == 0:
            return leaf.to(rng.choice((torch.float64, torch.int64, torch.bool, torch.complex64, torch.float16)))
        if kind == 1:
            return leaf[None]
        if kind == 2:
            return leaf.reshape(-1)[:-1]
        if kind == 3:
            return torch.zeros(rng.choice(((), (0,), (3, 3), (1, 2, 3, 4))))
        if kind == 4:
            return leaf * torch.tensor(rng.choice((float("nan"), float("inf"), 0.0, 1e30)))
        return torch.zeros(1).expand(rng.choice(((10**9,), (10**6, 10**6))))  # a small file that claims to be large

    tree = Pickled() if rng.random() < 0.03 else change_tree(_lists(tree), rng, change=changed)
    torch.save(tree, path)


def _lists(tree: Any) -> Any:
    """Convert to plain dictionaries and lists, which can be changed in place."""
    if isinstance(tree, dict):
        return {key: _lists(value) for key, value in tree.items()}
    return [_lists(value) for value in tree] if isinstance(tree, (list, tuple)) else tree


def change_parquet(path: Path, rng: Random) -> None:
    """Change, drop, rename or convert a column; drop or repeat rows."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    name, kind = rng.choice(table.column_names), rng.randrange(7)
    at, rows = table.column_names.index(name), table.num_rows
    if kind == 0:
        table = table.drop_columns([name])
    elif kind == 1:
        table = table.rename_columns(
            [rng.choice(WORDS[2:]).replace("\ud800", "?") if one == name else one for one in table.column_names]
        )
    elif kind == 2:
        table = table.slice(0, rng.choice((0, max(rows - 1, 0))))
    elif kind == 3:
        table = pa.concat_tables([table, table])
    else:
        column = rng.choice((
            pa.array([None] * rows, pa.float64()), pa.array(["x"] * rows), pa.array([float("nan")] * rows), pa.array([-1] * rows), pa.array([2**62] * rows),
            pa.array([[1.0]] * rows), pa.array([[]] * rows, pa.list_(pa.float32())), pa.array([[None, 1.0]] * rows), pa.array([True] * rows),
            pa.array([[1e38] * 14] * rows), pa.array([{"a": 1}] * rows), pa.array([1e308] * rows),
        ))  # fmt: skip
        table = table.set_column(at, name, column)
    pq.write_table(table, path)


def change_jsonl(text: str, rng: Random) -> str:
    """Change a line of JSON lines as JSON, drop it or repeat it."""
    lines = text.splitlines()
    at = rng.randrange(len(lines)) if lines else 0
    if lines and rng.random() < 0.8:
        try:
            json.loads(lines[at])
        except ValueError:
            return text
        lines[at] = change_json(lines[at], rng).replace("\n", " ")
    elif lines:
        lines = lines[:at] + lines[at + 1 :] if rng.random() < 0.5 else [*lines, lines[at]]
    return "\n".join(lines) + rng.choice(("\n", "\n", "", "\r", "{"))
