"""Screening: where a refit begins, for an effect whose shape has to be found among many."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from embodiedreamer_gym.diagnosis.effect_starts import start_of
from embodiedreamer_gym.diagnosis.screening import linearise, screen_effect
from embodiedreamer_gym.effects.torque_ripple import TorqueRipple
from embodiedreamer_gym.phys_aligner.calibration import fit_least_squares
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from tests.bank import case


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.release)])
def test_a_ripple_is_started_near_its_own_frequency(seed: int) -> None:
    robot, model = case("torque_ripple", "pendulum1", seed)
    problem, fit = fit_least_squares(model, robot.train)
    short, points = linearise(problem, fit, None)
    found = screen_effect(TorqueRipple, points, short, np.ones(1))
    assert found.rollouts == 19 * 6  # frequencies, phases; of one size
    new = Problem(points[0].model.with_effect(TorqueRipple), robot.train)
    better = new.model_at(minimise(new, start_of(new, found.start)).x).effects[0].values
    truth = robot.truth["values"]
    assert better["frequency"]["joint1"] == pytest.approx(truth["frequency"]["joint1"], rel=0.05)
    assert better["amplitude"]["joint1"] == pytest.approx(truth["amplitude"]["joint1"], rel=0.15)
