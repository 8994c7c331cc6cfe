"""Where the refit of an effect begins."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.candidates import Candidate, Trial, finish_refit
from embodiedreamer_gym.diagnosis.effect_starts import Starts, pair_starts, single_starts
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.limits import limit_starts, release_limits
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.phys_aligner.least_squares import fit_at
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import ParameterKey
from tests.two_joint_arm import load_arm, record


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def start(kind, value):
    return {ParameterKey(p.name, kind.name): np.full(2, value) for p in kind.parameters}


def test_a_limit_is_tried_off_where_a_joint_may_not_reach_it(arm) -> None:
    kind = CATALOGUE["torque_saturation"]
    key = ParameterKey("limit", kind.name)
    model = arm.with_effect(kind)
    starts = single_starts(kind, model, start(kind, 2.0), {})
    tried = np.array([values[key][0] for values in starts.first])
    assert model.parameter_off(kind.parameters[0])[0] in tried
    assert tried.min() < 2.0 < np.sort(tried)[-2]


def test_an_effect_with_two_directions_is_tried_in_both(arm) -> None:
    kind = CATALOGUE["torque_bias"]
    key = ParameterKey(kind.parameters[0].name, kind.name)
    tried = [v[key][0] for v in single_starts(kind, arm.with_effect(kind), start(kind, 0.0), {}).first]
    assert min(tried) < 0 < max(tried)


def test_each_joint_begins_at_its_own_best_size(arm) -> None:
    """One joint lags by 10 ms and the other by 60 ms."""
    kind = CATALOGUE["command_delay"]
    delays = {"shoulder": 0.01, "elbow": 0.06}
    log = record(arm.with_effect(kind).with_values({"command_delay.seconds": delays}))
    model = arm.with_effect(kind)
    problem = Problem(model, [log])
    x = single_starts(kind, model, start(kind, 0.0), {}).best(problem)
    found = problem.model_at(x).effects[0].values["seconds"]
    assert found["shoulder"] < 0.03 < found["elbow"]


def profile(arm, shoulder, elbow):
    """The arm with a profile, with these speed limits, rad/s."""
    speeds = {"shoulder": shoulder, "elbow": elbow}
    values = {"profile.acceleration": {"shoulder": 8.0, "elbow": 8.0}, "profile.speed": speeds}
    return arm.with_effect(CATALOGUE["profile"]).with_values(values)


def test_a_limit_that_a_fit_does_not_reach_is_found_by_a_scan(arm) -> None:
    """The speed limit begins at several times the joint's largest speed, where the cost has no derivative."""
    problem = Problem(profile(arm, 0.4, 50.0), [record(profile(arm, 0.4, 50.0))])
    x = Problem(profile(arm, 6.0, 50.0), problem.recordings).start
    starts = limit_starts(problem, x, np.ones(problem.model.n, bool))
    assert starts is not None
    found = problem.model_at(starts.best(problem)).effects[0].values["speed"]
    assert found["shoulder"] == pytest.approx(0.4, rel=0.15)
    assert found["elbow"] > 2.0  # rad/s, which it does not reach


def test_a_refit_scans_and_releases_limits(arm) -> None:
    """It begins where neither joint reaches its limit; the test motion is that of the fit."""
    log = record(profile(arm, 0.4, 50.0), noise=1e-3)
    problem = Problem(profile(arm, 6.0, 10.0), [log])
    fit = fit_at(problem, problem.start)
    kind = CATALOGUE["profile"]
    begun = Candidate(kind, problem.model, problem, fit, evaluate(problem.model, [log]), 0)
    done = finish_refit(Trial(kind, problem.model, Starts(({},)), (None,)), begun, [log], 0)
    speed = done.model.effects[0].values["speed"]
    assert speed["shoulder"] == pytest.approx(0.4, rel=0.05) and speed["elbow"] == pytest.approx(50.0)
    assert done.held_out.chi2.max() < 1.4


def test_a_limit_that_the_motion_does_not_need_is_released(arm) -> None:
    """The shoulder's speed is limited; the elbow never reaches 10 rad/s."""
    problem = Problem(profile(arm, 0.4, 10.0), [record(profile(arm, 0.4, 50.0), noise=1e-3)])
    fit = release_limits(problem, fit_at(problem, problem.start))
    profiled = problem.model_at(fit.x).effects[0].values
    assert profiled["speed"]["elbow"] == pytest.approx(50.0)
    assert profiled["speed"]["shoulder"] == pytest.approx(0.4)
    assert profiled["acceleration"] == pytest.approx({"shoulder": 8.0, "elbow": 8.0})


def test_a_model_without_limits_has_none_to_scan(arm) -> None:
    problem = Problem(arm.with_effect(CATALOGUE["command_delay"]), [record(arm)])
    assert limit_starts(problem, problem.start, np.ones(problem.model.n, bool)) is None
    fit = fit_at(problem, problem.start)
    assert release_limits(problem, fit) is fit


def test_two_limits_are_tried_independently(arm) -> None:
    """A profile's acceleration with each of several speeds."""
    kind = CATALOGUE["profile"]
    starts = single_starts(kind, arm.with_effect(kind), start(kind, 2.0), {})
    tried = {
        (v[ParameterKey("acceleration", kind.name)][0], v[ParameterKey("speed", kind.name)][0]) for v in starts.first
    }
    assert len({speed for acceleration, speed in tried if acceleration == pytest.approx(1.6)}) == 5


def test_a_pair_begins_on_a_grid_of_both(arm) -> None:
    kinds = (CATALOGUE["command_delay"], CATALOGUE["coulomb_friction"])
    model = arm.with_effect(kinds[0]).with_effect(kinds[1])
    nominal = {ParameterKey("stiffness"): arm.stiffness}
    starts = pair_starts(kinds, model, {**start(kinds[0], 0.0), **start(kinds[1], 0.0)}, nominal)
    assert len(starts.first) == len(starts.second) == 7  # six sizes, and off
    assert all(ParameterKey("stiffness") in values for values in starts.first)
    assert not any(ParameterKey("stiffness") in values for values in starts.second)
