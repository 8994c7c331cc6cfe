"""Reference banks as npz files."""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.io.files import atomic_file, check_regular
from embodiedreamer_gym.vis_aligner.bank import Array, Bank, Entry
from embodiedreamer_gym.vis_aligner.clip import Bench, Gallery
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.light import Light
from embodiedreamer_gym.vis_aligner.shadows import Plane
from embodiedreamer_gym.vis_aligner.table_atlas import TableAtlas

VERSION = 2  # of the file format; since 2, a bench may have a light, and its picture then has no shadows on the table
MOST_LIGHTS = 1000
MOST_BYTES = 1_500_000_000  # of a bank's arrays


def save_bank(bank: Bank, path: str | Path) -> None:
    """Write a bank as npz, atomically.

    Raises: VisionError where it cannot be written.
    """
    data: dict[str, Array] = {
        "version": np.array(VERSION), "plate": bank.plate, "frames": np.stack([e.frame for e in bank.entries]),
        "classes": np.stack([e.classes for e in bank.entries]), "props": np.array(["\n".join(e.props) for e in bank.entries]),
    }  # fmt: skip
    if bank.bench is not None:
        data |= {
            "bench": bank.bench.picture,
            "bench.seen": bank.bench.seen,
            **_gallery_arrays("gallery", bank.bench.gallery),
            **_photos_arrays("object", bank.bench.things),
        }
        if bank.bench.grain is not None:
            data["bench.grain"] = np.array(bank.bench.grain)
        if (light := bank.bench.light) is not None:
            data |= {f"light.{key}": getattr(light, key) for key in ("positions", "strengths", "receivers", "matrix")}
            data["light.plane"] = np.append(light.plane.normal, light.plane.offset)
    if bank.moving is not None:
        data |= _gallery_arrays("moving", bank.moving.gallery) | _photos_arrays("thing", bank.moving.things)
        if (atlas := bank.moving.atlas) is not None:
            data |= {
                "atlas": atlas.picture,
                "atlas.seen": atlas.seen,
                "atlas.place": np.append(atlas.corner, atlas.height),
            }
    if all(e.joints is not None for e in bank.entries):
        data["joints"] = np.stack([np.asarray(e.joints) for e in bank.entries])
    for name in sorted({n for e in bank.entries for n in (e.poses or {})}):
        missing = np.full(7, np.nan)
        data[f"pose.{name}"] = np.stack([np.asarray((e.poses or {}).get(name, missing)) for e in bank.entries])
    with atomic_file(path, VisionError, ".part.npz") as part:
        np.savez_compressed(part, **data)  # pyright: ignore[reportArgumentType]


def load_bank(path: str | Path) -> Bank:
    """Read a bank.

    Raises: VisionError where the file is missing, is not a bank, or holds more than MOST_BYTES.
    """
    try:
        arrays = _arrays(path)
        if int(version := arrays.get("version", np.array(1))) > VERSION:
            raise ValueError(f"it has version {int(version)}, but this package reads versions up to {VERSION}")
        frames, plate = arrays["frames"], arrays["plate"]
        if frames.ndim != 4 or plate.shape != frames.shape[1:] or {frames.dtype, plate.dtype} != {np.dtype(np.uint8)}:
            raise ValueError("its photos are not (N, H, W, 3) uint8 with a plate of the same size")
        names = [key.removeprefix("pose.") for key in arrays if key.startswith("pose.")]
        entries = []
        for i, (frame, classes) in enumerate(zip(frames, arrays["classes"], strict=True)):
            poses = {n: arrays[f"pose.{n}"][i] for n in names if np.isfinite(arrays[f"pose.{n}"][i]).all()}
            props = tuple(str(arrays["props"][i]).split("\n"))
            joints = arrays["joints"][i] if "joints" in arrays else None
            entries.append(Entry(frame, classes, joints, poses or None, props))
        return Bank(plate, tuple(entries), _bench(arrays), _moving(arrays))
    except (OSError, LookupError, TypeError, ValueError, AttributeError, EOFError, RuntimeError, zlib.error,
            zipfile.BadZipFile, SyntaxError, tokenize.TokenError) as error:  # fmt: skip
        raise VisionError(
            f"{path} is not a reference bank ({error}); make one with `embodiedreamer vis bank`."
        ) from error


def _arrays(path: str | Path) -> dict[str, Array]:
    """Arrays of an npz file, after a check that no header claims more bytes than the file holds.

    Raises: ValueError, OSError or zipfile.BadZipFile if the file is invalid or too large.
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
    """The bench in a file; None if it has none."""
    if "bench" not in arrays:
        return None
    if arrays["bench"].shape != arrays["plate"].shape:
        raise ValueError("the bench's picture has another size than the plate")
    if arrays["bench"].dtype != np.uint8:
        raise ValueError("bench is not uint8")
    grain = float(arrays["bench.grain"]) if "bench.grain" in arrays else None
    seen = arrays["bench.seen"].astype(bool)
    return Bench(
        arrays["bench"], seen, _gallery(arrays, "gallery"), _light(arrays), grain, things=_photos(arrays, "object")
    )


def _moving(arrays: Mapping[str, Array]) -> Bench | None:
    """A file's bench for cameras that move; None if it has none."""
    if "moving" not in arrays and "atlas" not in arrays:
        return None
    atlas = None
    if "atlas" in arrays:
        x, y, height = arrays["atlas.place"].astype(float)
        atlas = TableAtlas(arrays["atlas"], arrays["atlas.seen"].astype(bool), np.array([x, y]), float(height))
    nothing = np.zeros_like(arrays["plate"])
    return Bench(nothing, nothing[..., 0] > 0, _gallery(arrays, "moving"), atlas=atlas, things=_photos(arrays, "thing"))


def _gallery_arrays(key: str, gallery: Gallery | None) -> dict[str, Array]:
    """A gallery's arrays by name; each name starts with the key. Empty without a gallery."""
    if gallery is None:
        return {}
    seen = {field.name: getattr(gallery.condition, field.name) for field in fields(gallery.condition)}
    return {key: gallery.frames} | {f"{key}.{name}": array for name, array in seen.items() if array is not None}


def _photos_arrays(kind: str, things: Mapping[str, Gallery]) -> dict[str, Array]:
    """Arrays of photos of objects, each under `kind:NAME`."""
    return {
        key: data for name, photos in things.items() for key, data in _gallery_arrays(f"{kind}:{name}", photos).items()
    }


def _photos(arrays: Mapping[str, Array], kind: str) -> dict[str, Gallery]:
    """The photos of objects that a file has under `kind:NAME`, by name."""
    names = [key.removeprefix(f"{kind}:") for key in arrays if key.startswith(f"{kind}:") and "." not in key]
    return {name: photos for name in names if (photos := _gallery(arrays, f"{kind}:{name}")) is not None}


def _gallery(arrays: Mapping[str, Array], key: str) -> Gallery | None:
    """The gallery from a file's arrays whose names start with the key; None if there is none."""
    if key not in arrays:
        return None
    seen = {name.removeprefix(f"{key}."): data for name, data in arrays.items() if name.startswith(f"{key}.")}
    for name, data in ((key, arrays[key]), *((n, seen[n]) for n in ("rgb", "classes", "parts") if n in seen)):
        if data.dtype != np.uint8:
            raise ValueError(f"{name} is not uint8")
    seen["depth"] = seen["depth"].astype(np.float32)
    return Gallery(arrays[key], Condition(**seen))


def _light(arrays: Mapping[str, Array]) -> Light | None:
    """The light of the bench in a file; None if it has none."""
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
