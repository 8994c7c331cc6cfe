"""Trained aligners as files: a lean model in one file, a diffusers model in a folder."""

from __future__ import annotations

from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.aligner import Aligner
from embodiedreamer_gym.vis_aligner.bank import Bank
from embodiedreamer_gym.vis_aligner.bank import load_bank as read_bank
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs

ASSETS = resources.files("embodiedreamer_gym") / "assets" / "vis"
SHIPPED = {"lean": "lean.pt"}
BANKS = {"lab": "lab.npz"}


def save_lean(network: Lean, chunk: int, path: str | Path) -> None:
    """Write a lean model (half precision), beside and renamed; chunk: frames that it was trained on."""
    path = Path(path)
    part = path.with_name(f".{path.name}.part")
    state = {name: value.half() for name, value in network.state_dict().items()}
    torch.save({"kind": "lean", "config": asdict(network.config), "chunk": chunk, "state": state}, part)
    part.replace(path)


def load_lean(path: str | Path) -> tuple[Lean, int]:
    """A lean model and the frames of its chunk.

    Raises: VisionError where the file is missing, or no lean model.
    """
    path = Path(path)
    if not path.is_file():
        raise VisionError(
            f"aligner {path} does not exist; give 'lean', a file of `embodiedreamer vis train`, or a folder."
        )
    try:
        data = torch.load(path, weights_only=True, map_location="cpu")
        config = dict(data["config"])
        config["inputs"] = Inputs(**config["inputs"])
        config["widths"] = tuple(config["widths"])
        network = Lean(LeanConfig(**config))
        network.load_state_dict({name: value.float() for name, value in data["state"].items()})
        return network, int(data["chunk"])
    except Exception as error:  # whatever a damaged or foreign file raises
        raise VisionError(f"{path} is no lean model of this version: damaged, or another file.") from error


def load_aligner(name: str | Path, steps: int = 1, seed: int = 0) -> Aligner:
    """The aligner "lean" (shipped), of a file, or of a folder with a diffusers model.

    Raises: VisionError where there is none.
    """
    path = Path(str(ASSETS / SHIPPED[str(name)])) if str(name) in SHIPPED else Path(name)
    if path.is_dir():
        from embodiedreamer_gym.vis_aligner.svd import load_svd  # needs the extra [svd]

        return load_svd(path, steps=steps, seed=seed)
    network, chunk = load_lean(path)
    return LeanAligner(network, chunk, steps, seed, path.stem)


def load_bank(name: str | Path) -> Bank:
    """The bank "lab" (shipped), or of a file.

    Raises: VisionError where there is none.
    """
    return read_bank(str(ASSETS / BANKS[str(name)]) if str(name) in BANKS else name)


def save_aligner(aligner: Any, folder: str | Path) -> Path:
    """Write a trained aligner into a folder; returns what `load_aligner` takes."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(aligner, LeanAligner):
        save_lean(aligner.network, aligner.chunk, folder / "lean.pt")
        return folder / "lean.pt"
    from embodiedreamer_gym.vis_aligner.svd import save_svd

    save_svd(aligner, folder)
    return folder
