"""What an export wrote, and what the format has no place for."""

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
    """One part of a model: its name, and where it stands in the file or what the user loses without it."""

    name: str
    text: str


@dataclass(frozen=True, eq=False)
class Agreement:
    """How far a replay from the file is from the package's own: largest and mean difference (R, n) of R recordings, rad."""

    recordings: tuple[str, ...]
    joints: tuple[str, ...]
    largest: np.ndarray
    mean: np.ndarray

    def __str__(self) -> str:
        r, j = np.unravel_index(np.argmax(self.largest), self.largest.shape)
        return (
            f"replay in MuJoCo from the file, against the rollouts of `compare`: {1e3 * self.largest[r, j]:.3f} mrad at most "
            f"({self.joints[j]}, {self.recordings[r]}), {1e3 * self.mean.mean():.3f} mrad in the mean"
        )

    def as_dict(self) -> dict[str, Any]:
        """The figures as JSON, rad."""
        return {"largest_rad": float(self.largest.max()), "mean_rad": float(self.mean.mean()),
                "by_recording": {name: dict(zip(self.joints, row, strict=True))
                                 for name, row in zip(self.recordings, self.largest.tolist(), strict=True)}}  # fmt: skip


@dataclass(frozen=True)
class Export:
    """An exported model.

    written, lost: parts of the model by where they stand, and by what the user loses; notes: what else a user must know;
    timestep: s, of an MJCF; agreement: of replays, where recordings were given.
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
        """The same as JSON."""
        return {
            "model": self.model, "format": self.format, "path": str(self.path), "timestep": self.timestep,
            "exported": {part.name: part.text for part in self.written},
            "not_exported": {part.name: part.text for part in self.lost},
            "notes": list(self.notes), "agreement": self.agreement and self.agreement.as_dict(),
        }  # fmt: skip

    @property
    def comment(self) -> str:
        """The same for a comment of XML, which must not hold two dashes in a row."""
        text = f"\n{self}\n".replace("--", "- -")
        return text + " " if text.endswith("-") else text


def joint_notes(model: RobotModel) -> list[str]:
    """What a user must know of joints that are recorded in another unit than a file's, or are not driven."""
    fixed = [str(joint.get("name")) for joint in read_xml(model.urdf).iter("joint")
             if joint.get("type") in MOVABLE and joint.get("name") not in model.tree.joint_names]  # fmt: skip
    return [
        *(f"{name} is recorded as 0 to 1; here it is {low:g} to {high:g} (rad or m), commands too."
          for name, (low, high) in model.normalised.items()),
        *([f"The model does not drive {', '.join(fixed)}: fixed at zero."] if fixed else []),
    ]  # fmt: skip


def _wrap(text: str, indent: int) -> str:
    return textwrap.fill(text, 118, initial_indent="  " if indent else "", subsequent_indent=" " * indent)
