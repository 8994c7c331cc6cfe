"""Reference banks as npz files."""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.files import atomic_file, check_regular
from embodiedreamer_gym.vis_aligner.bank import Array, Bank, Entry
from embodiedreamer_gym.vis_aligner.clip import Bench, Gallery
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.light import Light
from embodiedreamer_gym.vis_aligner.shadows import Plane

VERSION = 2  # of the files; since 2 a bench may have a light, and then its picture shows no shadow on the table
MOST_LIGHTS = 1000
MOST_BYTES = 1_500_000_000  # of a bank's arrays


def save_bank(bank: Bank, path: str | Path) -> None:
    """Write a bank as npz, whole or not at all.

    Raises: VisionError where it cannot be written.
    """
    data: dict[str, Array] = {
        "version": np.array(VERSION), "plate": bank.plate, "frames": np.stack([e.frame for e in bank.entries]),
        "classes": np.stack([e.classes for e in bank.entries]), "props": np.array(["\n".join(e.props) for e in bank.entries]),
    }  # fmt: skip
    if bank.bench is not None:
        data |= {"bench": bank.bench.picture, "bench.seen": bank.bench.seen}
        if bank.bench.gallery is not None:
            seen = vars(bank.bench.gallery.condition)
            data["gallery"] = bank.bench.gallery.frames
            data |= {f"gallery.{key}": array for key, array in seen.items() if array is not None}
        if bank.bench.grain is not None:
            data["bench.grain"] = np.array(bank.bench.grain)
        if (light := bank.bench.light) is not None:
            data |= {f"light.{key}": getattr(light, key) for key in ("positions", "strengths", "receivers", "matrix")}
            data["light.plane"] = np.append(light.plane.normal, light.plane.offset)
    if all(e.joints is not None for e in bank.entries):
        data["joints"] = np.stack([np.asarray(e.joints) for e in bank.entries])
    for name in sorted({n for e in bank.entries for n in (e.poses or {})}):
        missing = np.full(7, np.nan)
        data[f"pose.{name}"] = np.stack([np.asarray((e.poses or {}).get(name, missing)) for e in bank.entries])
    with atomic_file(path, VisionError, ".part.npz") as part:
        np.savez_compressed(part, **data)  # pyright: ignore[reportArgumentType]


def load_bank(path: str | Path) -> Bank:
    """Read a bank.

    Raises: VisionError where it is missing, no bank, or larger than MOST_BYTES.
    """
    try:
        arrays = _arrays(path)
        if int(version := arrays.get("version", np.array(1))) > VERSION:
            raise ValueError(f"it is of version {int(version)}, and this package reads versions up to {VERSION}")
        frames, plate = arrays["frames"], arrays["plate"]
        if frames.ndim != 4 or plate.shape != frames.shape[1:] or {frames.dtype, plate.dtype} != {np.dtype(np.uint8)}:
            raise ValueError("its photos are not (N, H, W, 3) uint8 beside a plate of their size")
        names = [key.removeprefix("pose.") for key in arrays if key.startswith("pose.")]
        entries = []
        for i, (frame, classes) in enumerate(zip(frames, arrays["classes"], strict=True)):
            poses = {n: arrays[f"pose.{n}"][i] for n in names if np.isfinite(arrays[f"pose.{n}"][i]).all()}
            props = tuple(str(arrays["props"][i]).split("\n"))
            joints = arrays["joints"][i] if "joints" in arrays else None
            entries.append(Entry(frame, classes, joints, poses or None, props))
        return Bank(plate, tuple(entries), _bench(arrays))
    except (OSError, LookupError, TypeError, ValueError, AttributeError, EOFError, RuntimeError, zlib.error,
            zipfile.BadZipFile, SyntaxError, tokenize.TokenError) as error:  # fmt: skip
        raise VisionError(f"{path} is no reference bank ({error}); make one with `embodiedreamer vis bank`.") from error


def _arrays(path: str | Path) -> dict[str, Array]:
    """Arrays of an npz file whose headers claim no more than the file holds.

    Raises: ValueError, OSError or zipfile.BadZipFile for another file.
    """
    check_regular(path, VisionError, "bank")
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > MOST_BYTES:
            raise ValueError(f"it holds more than {MOST_BYTES / 1e9:.1f} GB")
        for entry in archive.infolist():
            with archive.open(entry) as file:
                version = np.lib.format.read_magic(file)
                header = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, kind = header(file)
            if math.prod(shape) * kind.itemsize > entry.file_size:
                raise ValueError(f"{entry.filename} is shorter than it claims")
    with np.load(path, allow_pickle=False) as data:
        return {key: data[key] for key in data.files}


def _bench(arrays: Mapping[str, Array]) -> Bench | None:
    """What a file knows of the bench."""
    if "bench" not in arrays:
        return None
    if arrays["bench"].shape != arrays["plate"].shape:
        raise ValueError("the bench's picture has another size than the plate")
    for key in ("bench", "gallery", "gallery.rgb", "gallery.classes", "gallery.parts"):
        if key in arrays and arrays[key].dtype != np.uint8:
            raise ValueError(f"{key} is not uint8")
    seen = {key.removeprefix("gallery."): data for key, data in arrays.items() if key.startswith("gallery.")}
    gallery = Gallery(arrays["gallery"], Condition(**seen)) if "gallery" in arrays else None
    grain = float(arrays["bench.grain"]) if "bench.grain" in arrays else None
    return Bench(arrays["bench"], arrays["bench.seen"].astype(bool), gallery, _light(arrays), grain)


def _light(arrays: Mapping[str, Array]) -> Light | None:
    """The light of a file's bench; None in files without."""
    if "light.positions" not in arrays:
        return None
    positions, strengths, matrix, plane = (
        arrays[f"light.{key}"].astype(float) for key in ("positions", "strengths", "matrix", "plane")
    )
    if len(positions) > MOST_LIGHTS or plane.shape != (4,):
        raise ValueError(
            f"its light has {len(positions)} points and a plane {plane.shape}, not up to {MOST_LIGHTS} and (4,)"
        )
    return Light(
        positions, strengths, Plane(plane[:3], float(plane[3])), arrays["light.receivers"].astype(bool), matrix
    )
