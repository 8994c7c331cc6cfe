"""Mutate one file, or a file of a folder: by its format, as bytes, or by replacing it with something else."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from random import Random

from benchmarks.fuzzing import arrays, texts

TEXTS: dict[str, tuple[Callable[[str, Random], str], ...]] = {
    ".csv": (texts.change_csv, texts.change_csv, texts.change_numbers, texts.change_words),
    ".json": (texts.change_json,),
    ".jsonl": (arrays.change_jsonl,),
    ".urdf": (texts.change_xml, texts.change_xml, texts.change_words),
    ".py": (texts.change_words, texts.change_numbers, texts.change_words),
    ".txt": (texts.change_words, texts.change_numbers),
}
FILES: dict[str, Callable[[Path, Random], None]] = {
    ".hdf5": arrays.change_hdf5, ".npz": arrays.change_npz, ".pt": arrays.change_torch,
    ".safetensors": arrays.change_safetensors, ".parquet": arrays.change_parquet,
}  # fmt: skip


def mutate(path: Path, rng: Random) -> Path:
    """Mutate a file, or some file of a folder; returns the path that was mutated."""
    if path.is_dir():
        inside = sorted(one for one in path.rglob("*") if one.is_file())
        return mutate(rng.choice(inside), rng)
    roll = rng.random()
    if roll < 0.06:
        _replace(path, rng)
    elif roll < 0.35 or path.suffix not in (*TEXTS, *FILES):
        path.write_bytes(texts.change_bytes(path.read_bytes(), rng))
    elif path.suffix in FILES:
        FILES[path.suffix](path, rng)
    elif roll < 0.42:
        path.write_bytes(texts.change_encoding(path.read_text(encoding="utf-8"), rng))
    else:
        text = rng.choice(TEXTS[path.suffix])(path.read_text(encoding="utf-8"), rng)
        path.write_bytes(text.encode("utf-8", "surrogatepass" if rng.random() < 0.5 else "replace"))
    return path


def _replace(path: Path, rng: Random) -> None:
    """Replace a file with something else."""
    path.unlink()
    kind = rng.randrange(7)
    if kind == 0:
        path.mkdir()
    elif kind == 1:
        path.symlink_to(path.name)
    elif kind == 2:
        path.symlink_to("/dev/null")
    elif kind == 3:
        os.mkfifo(path)
    elif kind == 4:
        path.write_bytes(b"")
    elif kind == 5:
        path.symlink_to("none")
