"""File that stores the finished fits of a long diagnosis, so that an interrupted one continues where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.io.files import MAX_BYTES, check_regular
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

SIGNALS = ("time", "position", "command", "effort", "usable", "noise", "quantum")
HOLDS = (None, "linear", "hold")


@dataclass(frozen=True, eq=False)
class CachedFit:
    """Result of a fit: scaled parameters x (m,), and the rule between two commands."""

    x: np.ndarray
    hold: str | None


class RefitCache:
    """Finished fits of one diagnosis: lines {"of", "fit": name, "x": scaled parameters, "hold"}.

    An incomplete last line is ignored. Fits of other recordings, models or catalogues in the same file are left alone:
    `of` identifies them. Without a path, nothing is stored.
    Raises: CalibrationError if the file is not such a cache or cannot be read or written.
    """

    def __init__(
        self, path: str | Path | None, model: RobotModel, recordings: Sequence[Recording], names: Iterable[str]
    ) -> None:  # fmt: skip
        self.path, self._of = None if path is None else Path(path), ""
        self._fits: dict[str, CachedFit] = {}
        if self.path is None:
            return
        self._of = _digest(model, recordings, names)
        try:
            text = self._read(self.path)
            for line in text[: text.rfind("\n") + 1].splitlines():
                row = json.loads(line)
                if row["of"] == self._of:
                    self._fits[row["fit"]] = _cached_fit(row)
            if text and not text.endswith("\n"):
                self.path.write_text(text[: text.rfind("\n") + 1], encoding="utf-8")
        except OSError as error:
            raise CalibrationError(f"refit cache {path} cannot be opened: {error.strerror or error}.") from error
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise CalibrationError(f"{path} is not a refit cache of a diagnosis; give another file.") from error

    @staticmethod
    def _read(path: Path) -> str:
        """Text of the file, "" if there is none.

        Raises: ValueError for a file that is too large or not UTF-8, CalibrationError for a pipe or a device.
        """
        if not path.exists():
            return ""
        check_regular(path, CalibrationError, "refit cache")
        if path.stat().st_size > MAX_BYTES:
            raise ValueError
        return path.read_text(encoding="utf-8")

    def get(self, fit: str) -> CachedFit | None:
        """The result of a fit, if it is finished."""
        return self._fits.get(fit)

    def keep(self, fit: str, x: np.ndarray, hold: str | None) -> None:
        """Store the result of a fit."""
        if self.path is None or fit in self._fits:
            return
        row = {"of": self._of, "fit": fit, "x": x.tolist(), "hold": hold}
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        except OSError as error:
            raise CalibrationError(f"refit cache {self.path} cannot be written: {error.strerror or error}.") from error


def _cached_fit(row: dict) -> CachedFit:
    """The fit of a line. Raises: ValueError for parameters that are not finite numbers, or an unknown rule."""
    x = np.array(row["x"], float)
    if x.ndim != 1 or not np.isfinite(x).all() or row["hold"] not in HOLDS:
        raise ValueError
    return CachedFit(x, row["hold"])


def _digest(model: RobotModel, recordings: Sequence[Recording], names: Iterable[str]) -> str:
    """Return a digest of model, URDF, recordings and catalogue."""
    parts = hashlib.sha256()
    inputs = {
        "parameters": [(row.name, row.value, row.low, row.high) for row in model.parameters()],
        "servo": [getattr(model, g).tolist() for g in ("stiffness", "damping", "rotor_inertia", "viscous_friction")],
        "joints": model.joints, "given": sorted(model.given), "hold": model.command_hold, "catalogue": list(names),
        "logs": [(r.joints, r.units, r.command_hold, r.effort_unit) for r in recordings],
    }  # fmt: skip
    if any((r.gain != 1).any() for r in recordings):
        inputs["gains"] = [r.gain.tolist() for r in recordings]
    parts.update(json.dumps(inputs, sort_keys=True).encode())
    parts.update(Path(model.urdf).read_bytes())
    for recording in recordings:
        for name in SIGNALS:
            array = getattr(recording, name)
            parts.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
    return parts.hexdigest()[:16]
