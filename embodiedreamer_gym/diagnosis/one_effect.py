"""Add one given effect to a calibrated model: screen it and refit the model, as a diagnosis does."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from embodiedreamer_gym.diagnosis.candidates import Candidate, polish, refit, single_trial
from embodiedreamer_gym.diagnosis.screening import LinearisationPoint, linearise, screen_effect
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.phys_aligner import Calibration
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibrated model to which effects are added.

    short, points: the problem on which effects are screened, and the parameters around which they are screened;
    both_rules: whether refits try both rules between two commands.
    """

    calibration: Calibration
    train: Sequence[Recording]
    test: Sequence[Recording]
    short: Problem
    points: Sequence[LinearisationPoint]
    both_rules: bool

    def with_effect(self, kind: type[Effect], all_joints: bool = False) -> Candidate:
        """The model refitted with one more effect, on the joints that it helps or on all joints."""
        model = self.calibration.model
        screened = screen_effect(kind, self.points, self.short, np.ones(model.n))
        if all_joints:
            screened = replace(screened, joints=None)
        trial = single_trial(model, screened, self.short.hold, self.both_rules)
        return polish(refit(trial, self.train, self.test), self.test)


def calibrated(
    model: RobotModel, train: Sequence[Recording], test: Sequence[Recording], progress: ProgressCallback
) -> Calibrated:  # fmt: skip
    """Calibrate a model to which effects will be added."""
    begun = time.perf_counter()
    problem, fit = fit_least_squares(model, train, progress=progress)
    calibration = finish(problem, fit, time.perf_counter() - begun)
    both_rules = model.command_hold == "unknown" and any(r.command_hold == "unknown" for r in train)
    return Calibrated(calibration, train, test, *linearise(problem, fit, model), both_rules)
