"""Report of an export: what was written, and what the format cannot express."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.urdf import MOVABLE, read_xml


@dataclass(frozen=True)
class Line:
    """One part of a model: its name, and its place in the file or what is lost without it."""

    name: str
    text: str


@dataclass(frozen=True, eq=False)
class Agreement:
    """Largest and mean difference (R, n), rad, between replays of R recordings from the file and model rollouts."""

    recordings: tuple[str, ...]
    joints: tuple[str, ...]
    largest: np.ndarray
    mean: np.ndarray

    def __str__(self) -> str:
        r, j = np.unravel_index(np.argmax(self.largest), self.largest.shape)
        return (
            f"replay in MuJoCo from the file, against the rollouts of `compare`: {1e3 * self.largest[r, j]:.3f} mrad "
            f"at most ({self.joints[j]}, {self.recordings[r]}), {1e3 * self.mean.mean():.3f} mrad on average"
        )

    def as_dict(self) -> dict[str, Any]:
        """The differences as JSON-compatible data, rad."""
        return {"largest_rad": float(self.largest.max()), "mean_rad": float(self.mean.mean()),
                "by_recording": {name: dict(zip(self.joints, row, strict=True))
                                 for name, row in zip(self.recordings, self.largest.tolist(), strict=True)}}  # fmt: skip


@dataclass(frozen=True)
class Export:
    """An exported model.

    written: parts of the model with their places in the file; lost: parts that were not exported, with the consequence;
    notes: further notes for the user; timestep: s, of an MJCF; agreement: of replays, if recordings were given.
    """

    model: str
    format: str
    path: Path
    written: tuple[Line, ...]
    lost: tuple[Line, ...]
    notes: tuple[str, ...]
    timestep: float | None = None
    agreement: Agreement | None = field(default=None)

    def __str__(self) -> str:
        lines = [f"{self.model} as {self.format.upper()}: {self.path}"]
        for title, parts in (("exported", self.written), ("not exported", self.lost)):
            lines += ["", f"{title}:" + ("" if parts else " nothing")]
            lines += [_wrap(f"{part.name:<30}{part.text}", 32) for part in parts]
        lines += ["", *(_wrap(note, 0) for note in self.notes)]
        return "\n".join([*lines, *(["", str(self.agreement)] if self.agreement else [])])

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON-compatible data."""
        return {
            "model": self.model, "format": self.format, "path": str(self.path), "timestep": self.timestep,
            "exported": {part.name: part.text for part in self.written},
            "not_exported": {part.name: part.text for part in self.lost},
            "notes": list(self.notes), "agreement": self.agreement and self.agreement.as_dict(),
        }  # fmt: skip

    @property
    def comment(self) -> str:
        """The report for an XML comment, which must not contain two dashes in a row."""
        text = f"\n{self}\n".replace("--", "- -")
        return text + " " if text.endswith("-") else text


def joint_notes(model: RobotModel) -> list[str]:
    """Notes for the user on joints that are recorded in another unit than the file's, or are not driven."""
    fixed = [str(joint.get("name")) for joint in read_xml(model.urdf).iter("joint")
             if joint.get("type") in MOVABLE and joint.get("name") not in model.tree.joint_names]  # fmt: skip
    return [
        *(f"{name} is recorded as 0 to 1; here it is {low:g} to {high:g} (rad or m), commands too."
          for name, (low, high) in model.normalised.items()),
        *([f"The model does not drive {', '.join(fixed)}: fixed at zero."] if fixed else []),
    ]  # fmt: skip


def _wrap(text: str, indent: int) -> str:
    return textwrap.fill(text, 118, initial_indent="  " if indent else "", subsequent_indent=" " * indent)
