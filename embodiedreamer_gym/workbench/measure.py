"""Cache of models' free runs and errors. The numbers are the same as those of `compare`."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from embodiedreamer_gym.diagnosis import Comparison, compare, regimes
from embodiedreamer_gym.diagnosis.compare import free_runs, joint_rms
from embodiedreamer_gym.diagnosis.comparison import measured_less_simulated
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Rollout

KEPT = 8  # number of cached runs and comparisons
ERRORS = 64  # number of models with a cached error
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Run:
    """One model's rollouts of the held-out recordings; errors: measured less simulated (T, n); joint_rms (n,)."""

    rollouts: tuple[Rollout, ...]
    errors: list[np.ndarray]
    joint_rms: np.ndarray

    @property
    def error(self) -> float:
        """Mean over joints of each joint's root mean square, as `Comparison.error`."""
        return float(np.nanmean(self.joint_rms[None], axis=1)[0])


class Measure:
    """Runs and errors of models on the held-out recordings, and on any recording that is shown."""

    def __init__(self, model: RobotModel, recordings: Sequence[Recording], label: str) -> None:
        self.recordings, self._label = tuple(recordings), label
        self.signals = Signals(model, recordings)
        self._kept: OrderedDict[tuple, object] = OrderedDict()
        self._errors: OrderedDict[RobotModel, float] = OrderedDict()

    def run(self, model: RobotModel) -> Run:
        """The model's free runs of the held-out recordings."""
        return self._once(("run", model), lambda: self._run(model))

    def error(self, model: RobotModel) -> float:
        """The model's held-out error."""
        if model not in self._errors:
            self._errors[model] = self.run(model).error
            if len(self._errors) > ERRORS:
                self._errors.popitem(last=False)
        self._errors.move_to_end(model)
        return self._errors[model]

    def comparison(self, model: RobotModel) -> Comparison:
        """The result of `compare` for the model on the held-out recordings."""
        return self._once(("compare", model), lambda: compare(model, self.recordings, [self._label]))

    def shown(self, model: RobotModel, recording: Recording) -> Rollout | None:
        """The model's run of one recording; None if the log has no command or is compared by effort."""
        if self.signals.by_effort or recording.command is None:
            return None
        if recording in self.recordings:
            return self.run(model).rollouts[self.recordings.index(recording)]
        return self._once(("shown", model, recording), lambda: free_runs(model, [recording])[0])

    def errors(self, model: RobotModel, recording: Recording) -> np.ndarray | None:
        """Measured minus simulated values (T, n) of a recording, in `unit`; None if there is no simulation."""
        if recording in self.recordings:
            return self.run(model).errors[self.recordings.index(recording)]
        run = self.shown(model, recording)
        return None if run is None else recording.position - run.position

    def unit(self, model: RobotModel, joint: int) -> str:
        """Unit of a joint's error."""
        return self.signals.unit or model.units[joint]

    def noise(self, model: RobotModel) -> np.ndarray:
        """Noise (n,) of each joint's error, in its `unit`; for efforts it depends on the model."""
        return self.comparison(model).joint_noise if self.signals.by_effort else self.signals.sigma

    def worst_instant(self, model: RobotModel, joint: int, regime: str) -> tuple[Recording, int]:
        """Recording and sample at which a joint's error is largest within a regime ("all": at any time).

        Raises: EmbodieDreamerError where the held-out recordings have no sample of that regime.
        """
        best: tuple[float, Recording | None, int] = (-1.0, None, 0)
        comparison = self.comparison(model)
        parts = zip(comparison.recordings, comparison.errors(0), comparison.signals.usable, strict=True)
        for place, (recording, error, usable) in enumerate(parts):
            keep = usable[:, joint]
            if regime != "all":
                keep = keep & regimes(model, recording)[regime][:, joint]
            size = np.where(keep, np.abs(error[:, joint]), -1.0)
            at = int(size.argmax())
            if size[at] > best[0]:
                best = float(size[at]), self.recordings[place], at
        if best[1] is None:
            raise EmbodieDreamerError(f"{model.joints[joint]} is never in the regime '{regime}' on held-out motion.")
        return best[1], best[2]

    def _run(self, model: RobotModel) -> Run:
        if self.signals.by_effort:  # such a comparison also fits the scale of the effort
            found = self.comparison(model)
            return Run(found.rollouts[0], found.errors(0), found.joint_rms[0])
        runs = free_runs(model, self.recordings)
        return Run(runs, measured_less_simulated(self.signals, runs), joint_rms(self.signals, runs))

    def _once(self, key: tuple, make: Callable[[], T]) -> T:
        if key not in self._kept:
            self._kept[key] = make()
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]  # pyright: ignore[reportReturnType]
