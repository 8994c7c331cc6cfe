"""Copies the meshes of an exported file into a folder beside it, so that both can be moved together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.io.files import atomic_file


def copy_meshes(names: Iterable[str], folder: Path, path: Path) -> dict[str, str]:
    """Copy mesh files into the folder FILE_meshes beside an exported file; returns name -> name relative to that file.

    names: paths; relative ones are in `folder`; missing files are left out. Files with the same name get numbers.
    Raises: ModelError when they cannot be written.
    """
    target, copied = path.with_name(f"{path.stem}_meshes"), {}
    taken: dict[str, Path] = {}
    for text in dict.fromkeys(names):
        source = (folder / text).resolve()
        if not source.is_file():
            continue
        name = source.name
        while taken.setdefault(name, source) != source:
            name = f"{source.stem}_{len(taken)}{source.suffix}"
        copied[text] = f"{target.name}/{name}"
    try:
        if taken:
            target.mkdir(exist_ok=True)
    except OSError as reason:
        raise ModelError(f"{target} cannot be written: {reason.strerror or reason}.") from reason
    for name, source in taken.items():
        if not ((target / name).exists() and (target / name).samefile(source)):
            with atomic_file(target / name, ModelError) as part:
                part.write_bytes(source.read_bytes())
    return copied


def mesh_notes(copied: Mapping[str, str], missing: Iterable[str], path: Path) -> list[str]:
    """Notes for the user on copied and missing meshes."""
    notes = [f"Meshes are copied into {path.stem}_meshes beside this file; keep both together."] if copied else []
    return [*notes, *(f"The mesh {name} is missing, or has a format that MuJoCo cannot read." for name in missing)]
