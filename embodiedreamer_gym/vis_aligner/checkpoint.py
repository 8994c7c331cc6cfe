"""Saves and loads trained aligners: a lean model is one file, a diffusers model is a folder."""

from __future__ import annotations

from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.learning.checkpoint import read_state, write_state
from embodiedreamer_gym.learning.device import find_device
from embodiedreamer_gym.vis_aligner.aligner import MOST_FRAMES, Aligner
from embodiedreamer_gym.vis_aligner.bank import Bank
from embodiedreamer_gym.vis_aligner.bank_files import load_bank as read_bank
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from embodiedreamer_gym.vis_aligner.moving_view import AssembledAligner
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdSettings

ASSETS = resources.files("embodiedreamer_gym") / "assets" / "vis"
SHIPPED = {"lean": "lean.pt"}
BANKS = {"lab": "lab.npz"}
OLD_INPUTS = {"carry": "reproject"}  # names in models of version 0.1


def save_lean(network: Lean, chunk: int, path: str | Path) -> None:
    """Write a lean model (half precision); chunk: number of frames of a clip in training.

    Raises: VisionError where it cannot be written.
    """
    state = {name: value.half().cpu() for name, value in network.state_dict().items()}
    write_state({"kind": "lean", "config": asdict(network.config), "chunk": chunk, "state": state}, path, VisionError)


def load_lean(path: str | Path) -> tuple[Lean, int]:
    """A lean model and the number of frames of its chunk.

    Raises: VisionError where the file is missing, or is not a lean model.
    """
    path = Path(path)
    if not path.is_file():
        raise VisionError(
            f"aligner {path} does not exist; give 'lean', a file of `embodiedreamer vis train`, or a folder."
        )
    damaged = VisionError(f"{path} is not a lean model of this version; it is damaged or another kind of file.")
    data = read_state(path, damaged)
    try:
        config: dict[str, Any] = dict(data["config"])
        given: dict[str, Any] = config["inputs"]
        inputs = {OLD_INPUTS.get(name, name): bool(used) for name, used in given.items()}
        widths, gate = tuple(config["widths"]), bool(config["gate"])
        network, chunk = Lean(LeanConfig(widths, Inputs(**inputs), gate)), int(data["chunk"])
        network.load_state_dict({name: value.float() for name, value in data["state"].items()})
    except (LookupError, TypeError, ValueError, AttributeError, RuntimeError, OverflowError) as error:
        raise damaged from error
    if not 1 <= chunk <= MOST_FRAMES:
        raise damaged
    return network, chunk


def load_aligner(name: str | Path, steps: int | None = None, seed: int = 0, device: str = "cpu",
                 svd: SvdSettings | None = None) -> Aligner:  # fmt: skip
    """The aligner "lean" (shipped), "assembled" (without a network), or from a file or a diffusers model's folder.

    steps: of diffusion; None for 1 with a lean model, 4 with a diffusers model.
    device: device of the networks: cpu, cuda, ..., or auto, which takes an accelerator if there is one.
    svd: settings of a diffusers model; None for its defaults, and for other models, which have no such settings.
    Raises: VisionError where there is no such model, the device is not available, or svd is given for another model.
    """
    if str(name) == AssembledAligner.name:
        check_lean(svd, str(name), "no svd")
        return AssembledAligner()
    path = Path(str(ASSETS / SHIPPED[str(name)])) if str(name) in SHIPPED else Path(name)
    if path.is_dir():
        from embodiedreamer_gym.vis_aligner.svd import load_svd  # needs the extra [svd]

        return load_svd(path, steps, seed, device, svd)
    check_lean(svd, str(name))
    where = find_device(device, VisionError)
    network, chunk = load_lean(path)
    return LeanAligner(network.to(where), chunk, 1 if steps is None else steps, seed, path.stem)


def check_lean(svd: SvdSettings | None, name: str, kind: str = "lean") -> None:
    """Raises: VisionError where settings of a diffusers model are given for a model of another kind."""
    if svd is not None:
        raise VisionError(
            f"bf16, gradient checkpointing and decode_chunk_size are only for svd aligners, but {name} is {kind}; leave them out."
        )


def load_bank(name: str | Path) -> Bank:
    """The bank "lab" (shipped), or one from a file.

    Raises: VisionError where there is no such bank.
    """
    return read_bank(str(ASSETS / BANKS[str(name)]) if str(name) in BANKS else name)


def save_aligner(aligner: Any, folder: str | Path) -> Path:
    """Write a trained aligner into a folder; returns the path for `load_aligner`."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(aligner, LeanAligner):
        save_lean(aligner.network, aligner.chunk, folder / "lean.pt")
        return folder / "lean.pt"
    from embodiedreamer_gym.vis_aligner.svd import save_svd

    save_svd(aligner, folder)
    return folder
