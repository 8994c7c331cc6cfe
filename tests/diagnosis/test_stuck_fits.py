"""Fits that end in a wrong valley, and what faultless robots are where a law jumps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import null_distribution
from embodiedreamer_gym.diagnosis.candidates import Candidate, leave_valley
from embodiedreamer_gym.diagnosis.effect_starts import start_of
from embodiedreamer_gym.diagnosis.exactness import fit_together
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.search_state import SearchState
from embodiedreamer_gym.diagnosis.shapes import shape_starts
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.phys_aligner.least_squares import fit_at, minimise
from embodiedreamer_gym.phys_aligner.problem import STEP, Problem
from tests.two_joint_arm import load_arm, record, wave

NOISE = 4e-4  # rad


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def deadzone(arm, width):
    """The arm with a dead zone of its servos, which jump back to the whole torque at its edge."""
    model = arm.with_effect(CATALOGUE["servo_deadzone"])
    return model.with_values({"servo_deadzone.width": {"shoulder": width, "elbow": width}})


@pytest.fixture(scope="module")
def stuck(arm):
    """A fit that began at twice the width, and a held-out log."""
    logs = [record(deadzone(arm, 0.05), noise=NOISE, seed=seed) for seed in (0, 1, 2)]
    problem = Problem(deadzone(arm, 0.1), logs[:2])
    return problem, minimise(problem, problem.start), logs[2:]


def test_long_steps_lead_out_of_the_small_valleys_of_a_law_that_jumps(stuck) -> None:
    problem, fit, _ = stuck
    assert problem.joint_rms(fit.residuals).max() ** 2 > 5
    better = leave_valley(problem, fit)
    assert problem.joint_rms(better.residuals).max() ** 2 < 1.2
    width = problem.model_at(better.x).effects[0].values["width"]
    assert width == pytest.approx({"shoulder": 0.05, "elbow": 0.05}, rel=0.1)


def test_a_fit_that_leaves_only_noise_stays(arm) -> None:
    problem = Problem(deadzone(arm, 0.05), [record(deadzone(arm, 0.05), noise=NOISE)])
    fit = minimise(problem, problem.start)
    spent = problem.rollouts
    assert leave_valley(problem, fit) is fit and problem.rollouts == spent


def test_slopes_of_a_law_that_jumps_do_not_make_every_robot_pass_for_faultless(stuck, monkeypatch) -> None:
    """Over steps of 0.1 % the slopes of jumps are so steep that faultless robots seem to have the errors of a wrong model."""
    problem, fit, test = stuck
    model, most = problem.model_at(fit.x), []
    for answer in (null_distribution.ANSWER, STEP):
        monkeypatch.setattr(null_distribution, "ANSWER", answer)
        null = draw_null(model, fit, problem, test, np.random.default_rng(0))
        most.append(np.quantile(null.chi2, 0.95, axis=0).max())
    assert most[0] < 8 < 3 * most[0] < most[1], most


def spring(arm, stiffness, angle):
    """The arm with a spring at its elbow."""
    values = {"joint_spring.stiffness": {"shoulder": 0.0, "elbow": stiffness},
              "joint_spring.angle": {"shoulder": 0.3, "elbow": angle}}  # fmt: skip
    return arm.with_effect(CATALOGUE["joint_spring"]).with_values(values)


def test_other_shapes_are_tried_at_stuck_joints_only(arm) -> None:
    """A spring that seems to pull away from an angle near by pulls towards one far off; its size is off where the fit ended."""
    problem = Problem(spring(arm, 0.0, 0.3), [record(spring(arm, 1.0, -2.4), noise=NOISE)])
    starts = shape_starts(problem, problem.start, np.array([False, True]))
    assert starts is not None
    tried = [problem.model_at(start_of(problem, values)).effects[0].values for values in starts.first]
    assert {values["angle"]["shoulder"] for values in tried} == {0.3}
    assert {values["stiffness"]["shoulder"] for values in tried} == {0.0}
    found = problem.model_at(starts.best(problem)).effects[0].values
    assert found["angle"]["elbow"] < -0.9 and found["stiffness"]["elbow"] > 0


def test_ripples_are_tried_at_all_their_frequencies_and_phases(arm) -> None:
    kind = CATALOGUE["torque_ripple"]
    problem = Problem(arm.with_effect(kind), [record(arm)])
    starts = shape_starts(problem, problem.start, np.ones(2, bool))
    assert starts is not None
    frequencies, phases = (
        {values[key][0] for values in starts.first for key in values if key.parameter == name}
        for name in ("frequency", "phase")
    )
    shapes = {p.name: set(p.starts) for p in kind.parameters if p.starts}
    assert shapes["frequency"] <= frequencies and shapes["phase"] <= phases
    turn = np.sort(np.mod(sorted(shapes["phase"]), 2 * np.pi))
    assert np.diff([*turn, turn[0] + 2 * np.pi]).max() < 1.1  # rad


def test_effects_without_shapes_have_none_to_try(arm) -> None:
    problem = Problem(arm.with_effect(CATALOGUE["command_delay"]), [record(arm)])
    assert shape_starts(problem, problem.start, np.ones(2, bool)) is None


def test_of_an_effect_that_is_fixed_no_other_shapes_are_tried(arm) -> None:
    model = spring(arm, 1.0, 0.3).with_effect(CATALOGUE["command_delay"]).with_(fixed=frozenset({"joint_spring"}))
    problem = Problem(model, [record(arm)])
    assert shape_starts(problem, problem.start, np.ones(2, bool)) is None


def test_a_long_ripple_is_a_spring() -> None:
    """Within 0.2 rad, up to a constant torque."""
    ripple, spring = CATALOGUE["torque_ripple"], CATALOGUE["joint_spring"]
    assert spring.name in ripple.generalises
    joint = SimpleNamespace(position=np.linspace(-0.2, 0.2, 9)[:, None])
    wave = SimpleNamespace(amplitude=0.5, frequency=1.0, phase=np.pi)
    straight = SimpleNamespace(stiffness=0.5, angle=0.0)
    torques = [kind.law(0.0, joint, None, p)[0] for kind, p in ((ripple, wave), (spring, straight))]
    assert torques[0] == pytest.approx(torques[1], abs=0.01 * 0.1)


def limited(arm, speed):
    """The arm whose shoulder moves no faster than a speed, rad/s."""
    values = {
        "profile.acceleration": {"shoulder": 50.0, "elbow": 50.0},
        "profile.speed": {"shoulder": speed, "elbow": 50.0},
    }
    return arm.with_effect(CATALOGUE["profile"]).with_values(values)


@pytest.mark.parametrize("stiffness", [1.0, 1.5])
def test_a_limit_that_only_held_out_motion_reaches_is_fitted_to_all_motion(arm, stiffness) -> None:
    """But not where the model is wrong on the fitted motion too."""
    train, test = ([record(limited(arm, 2.0), noise=NOISE, command=size * wave(seed=1))] for size in (0.3, 1.5))
    wrong = arm.with_(stiffness=stiffness * arm.stiffness)
    problem = Problem(wrong, train)
    fit = fit_at(problem, problem.start)
    null = draw_null(
        arm, fit_at(Problem(arm, train), problem.start), Problem(arm, train), test, np.random.default_rng(0)
    )
    state = SearchState((wrong, problem, fit), evaluate(wrong, test), evaluate(wrong, train), null)
    refit = Problem(limited(wrong, 50.0), train)
    found = fit_at(refit, refit.start)
    state.steps = [Candidate(CATALOGUE["profile"], refit.model, refit, found, evaluate(refit.model, test), 0)]
    assert state.excess > 5
    fit_together(SimpleNamespace(train=train, test=test, rollouts=0), state)
    assert (state.together is None) == (stiffness != 1.0)
    assert stiffness != 1.0 or state.is_exact
