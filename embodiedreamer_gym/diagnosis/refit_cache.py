"""What a long diagnosis has found so far, kept in a file, so that an interrupted one goes on where it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

SIGNALS = ("time", "position", "command", "effort", "usable", "noise", "quantum")


@dataclass(frozen=True, eq=False)
class Known:
    """Where a fit ended: scaled parameters x (m,), and the rule between two commands."""

    x: np.ndarray
    hold: str | None


class Journal:
    """Finished fits of one diagnosis: lines {"of", "fit": name, "x": scaled parameters, "hold"}; a torn last is none.

    Fits of other recordings, models or catalogues in the same file are left alone: `of` tells them apart. Without a
    path nothing is kept.
    Raises: CalibrationError where the file is not such a journal.
    """

    def __init__(
        self, path: str | Path | None, model: RobotModel, recordings: Sequence[Recording], names: Iterable[str]
    ) -> None:  # fmt: skip
        self._path, self._of = None if path is None else Path(path), ""
        self._known: dict[str, Known] = {}
        if self._path is None:
            return
        self._of = _digest(model, recordings, names)
        text = self._path.read_text(encoding="utf-8") if self._path.exists() else ""
        for line in text[: text.rfind("\n") + 1].splitlines():
            try:
                row = json.loads(line)
                if row["of"] == self._of:
                    self._known[row["fit"]] = Known(np.array(row["x"], float), row["hold"])
            except (ValueError, KeyError, TypeError) as error:
                raise CalibrationError(f"{path} is no journal of a diagnosis; give another file.") from error
        if text and not text.endswith("\n"):
            self._path.write_text(text[: text.rfind("\n") + 1], encoding="utf-8")

    def known(self, fit: str) -> Known | None:
        """Where a fit ended, if it is finished."""
        return self._known.get(fit)

    def keep(self, fit: str, x: np.ndarray, hold: str | None) -> None:
        """Note where a fit ended."""
        if self._path is not None and fit not in self._known:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"of": self._of, "fit": fit, "x": x.tolist(), "hold": hold}) + "\n")


def _digest(model: RobotModel, recordings: Sequence[Recording], names: Iterable[str]) -> str:
    """A name of the question: model, URDF, recordings and catalogue."""
    parts = hashlib.sha256()
    told: Mapping[str, object] = {
        "parameters": [(row.name, row.value, row.low, row.high) for row in model.parameters()],
        "servo": [getattr(model, g).tolist() for g in ("stiffness", "damping", "rotor_inertia", "viscous_friction")],
        "joints": model.joints, "given": sorted(model.given), "hold": model.command_hold, "catalogue": list(names),
        "logs": [(r.joints, r.units, r.command_hold, r.effort_unit) for r in recordings],
    }  # fmt: skip
    parts.update(json.dumps(told, sort_keys=True).encode())
    parts.update(Path(model.urdf).read_bytes())
    for recording in recordings:
        for name in SIGNALS:
            array = getattr(recording, name)
            parts.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
    return parts.hexdigest()[:16]
