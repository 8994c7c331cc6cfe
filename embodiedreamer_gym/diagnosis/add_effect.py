"""add_effect: fit a model without and with one more effect, and compare both on held-out recordings."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from embodiedreamer_gym.diagnosis.compare import compare
from embodiedreamer_gym.diagnosis.comparison import Comparison
from embodiedreamer_gym.diagnosis.one_effect import calibrated
from embodiedreamer_gym.effects import find_effect
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.io.tables import milli
from embodiedreamer_gym.phys_aligner import Calibration
from embodiedreamer_gym.phys_aligner.calibration import finish, with_nuisances
from embodiedreamer_gym.phys_aligner.signals import with_effort_unit
from embodiedreamer_gym.recordings import Recording, as_recordings, thin
from embodiedreamer_gym.robot import RobotModel

MAX_SECONDS = 120.0  # s of motion used for fitting


@dataclass(frozen=True, eq=False)
class Addition:
    """Calibrations without and with an effect, and their comparison on held-out recordings."""

    effect: str
    before: Calibration
    after: Calibration
    comparison: Comparison

    @property
    def warning(self) -> str:
        """Sentence saying that the effect increased the held-out error, "" if it did not."""
        before, after = self.comparison.error
        if not after > before:
            return ""
        sizes = " to ".join(milli(float(error), self.comparison.unit) for error in (before, after))
        return f"The held-out error rose from {sizes}: {self.effect} makes this model worse."

    def __str__(self) -> str:
        return "\n\n".join(filter(None, [str(self.after), str(self.comparison), self.warning]))

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON."""
        parts = {"calibration": self.after.as_dict(), "comparison": self.comparison.as_dict()}
        return {"effect": self.effect, **parts, "held_out_error_rose": bool(self.warning)}


def add_effect(
    model: RobotModel, name: str, train: Recording | Sequence[Recording], test: Recording | Sequence[Recording],
    progress: ProgressCallback | None = None,
) -> Addition:  # fmt: skip
    """Calibrate the model, add the effect of that name, fit all parameters again and compare on held-out recordings.

    train, test: recordings for fitting, and held-out recordings for the comparison.
    progress: is called as the work advances.
    Raises: EffectError for an unknown effect, ModelError if the model already has it.
    """
    progress, train, test = progress_or_silence(progress), as_recordings(train), as_recordings(test)
    kind = find_effect(name, model.catalogue)
    model.with_effect(kind)  # raises, before any fit, if the model already has the effect
    logs = with_effort_unit(model, [*train, *test])
    train, test = thin(logs[: len(train)], MAX_SECONDS), logs[len(train) :]
    base = calibrated(with_nuisances(model, train), train, test, progress)
    progress("refitting effects", 0, 1, effect=name)
    begun = time.perf_counter()
    richer = base.with_effect(kind, all_joints=True)
    progress("refitting effects", 1, 1, effect=name)
    before, after = base.calibration, finish(richer.problem, richer.fit, time.perf_counter() - begun)
    return Addition(name, before, after, compare([before.model, after.model], test))
