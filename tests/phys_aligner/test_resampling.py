"""Intervals by resampling of a dead zone that jumps, on a two-joint arm."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.robot_errors import fit_with_robot_errors
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.phys_aligner import calibration
from embodiedreamer_gym.phys_aligner.calibration import finish
from embodiedreamer_gym.phys_aligner.least_squares import minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.phys_aligner.resampling import resampled_reach
from tests.two_joint_arm import load_arm, record

NOISE, WIDTH = 4e-4, 0.05  # rad


def deadzone(arm, width):
    """The arm with a dead zone of its servos, which jump back to the whole torque at its edge."""
    model = arm.with_effect(CATALOGUE["servo_deadzone"]).with_fixed("servo_deadzone.jump")
    values = {
        "servo_deadzone.width": {"shoulder": width, "elbow": width},
        "servo_deadzone.jump": {"shoulder": 1.0, "elbow": 1.0},
    }
    return model.with_values(values)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def problem(arm):
    """The arm and its own motion."""
    return Problem(deadzone(arm, WIDTH), [record(deadzone(arm, WIDTH), noise=NOISE, seed=seed) for seed in (0, 1, 2)])


def widths(problem):
    """Rows of the widths."""
    return np.array([row.key.parameter == "width" for row in problem.rows])


def test_only_the_rows_that_are_asked_for_reach_anywhere(problem) -> None:
    reach = resampled_reach(problem, problem.start, widths(problem))
    assert reach.shape == (2, len(problem.rows))
    assert (reach[:, ~widths(problem)] == 0).all() and (reach >= 0).all()
    assert (resampled_reach(problem, problem.start, widths(problem)) == reach).all()


def test_where_the_error_is_least_elsewhere_the_interval_reaches_there(problem) -> None:
    rows = np.flatnonzero(widths(problem))
    x = problem.start.copy()
    x[rows] = 1.1 * x[rows]
    below, above = resampled_reach(problem, x, widths(problem))
    assert below[rows] == pytest.approx(x[rows] - problem.start[rows], abs=0.1 * x[rows].max())
    assert (above[rows] == 0).all()


def test_a_parameter_that_does_nothing_has_no_interval(arm) -> None:
    """A limit that the motion does not reach: any larger one does as well."""
    problem = Problem(arm.with_effect(CATALOGUE["torque_saturation"]), [record(arm, noise=NOISE)])
    rows = np.array([row.key.effect == "torque_saturation" for row in problem.rows])
    x = np.where(rows, problem.upper - 1.5, problem.start)
    assert np.isinf(resampled_reach(problem, x, rows)[1, rows]).all()


@pytest.mark.parametrize("end", [0, 1])
def test_an_interval_of_which_one_end_is_infinite_is_none(arm, end, monkeypatch) -> None:
    problem = Problem(arm, [record(arm, noise=NOISE)])
    fit = minimise(problem, problem.start)
    name = problem.rows[0].name
    assert name in finish(problem, fit, 0.0).model.intervals

    def one_end(problem, x, half_width, rows):
        reach = np.repeat(half_width[None], 2, axis=0)
        reach[end, 0] = np.inf
        return reach

    monkeypatch.setattr(calibration, "with_jumps", one_end)
    found = finish(problem, fit, 0.0)
    assert name not in found.model.intervals and name in found.undetermined


@pytest.mark.release
def test_intervals_of_widths_hold_them_more_often_than_by_slopes(arm, monkeypatch) -> None:
    """Of six robots whose servos are a little stiffer than the model's, with friction that the model lacks."""
    said, held = 0, {True: 0, False: 0}
    truth = deadzone(arm, WIDTH).with_(stiffness=1.02 * arm.stiffness, viscous_friction=arm.viscous_friction + 0.02)
    for seed in range(6):
        logs = [record(truth, noise=NOISE, seed=10 * seed + k) for k in range(3)]
        problem = Problem(deadzone(arm, 1.01 * WIDTH), logs[:2])
        fit = minimise(problem, problem.start)
        wider = fit_with_robot_errors(problem, fit.x, logs)
        for resampled in held:
            with monkeypatch.context() as patch:
                if not resampled:
                    patch.setattr(
                        calibration, "with_jumps", lambda problem, x, half_width, rows: (half_width, half_width)
                    )
                found = finish(problem, fit, 0.0, wider).model.intervals
            intervals = [interval for name, interval in found.items() if name.startswith("servo_deadzone.width")]
            held[resampled] += sum(low <= WIDTH <= high for low, high in intervals)
        said += len(intervals)
    assert said == 12 and held[False] <= 3 and held[True] >= 9, held
