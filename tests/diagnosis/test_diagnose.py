"""The loop on a two-joint arm: nothing missing is not accused, what is missing is named, and the error falls."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import add_effect, diagnose
from embodiedreamer_gym.diagnosis.backward_elimination import drop_last, drop_redundant
from embodiedreamer_gym.diagnosis.candidates import Candidate
from embodiedreamer_gym.diagnosis.held_out import HeldOut, evaluate, gain, score
from embodiedreamer_gym.diagnosis.null_distribution import draw_null
from embodiedreamer_gym.diagnosis.verdict import (
    contenders,
    explained,
    improves,
    is_convincing,
    leaves_excess,
    total_explainable,
    total_explained,
)
from embodiedreamer_gym.effects import CATALOGUE, Parameter, SignalLaw
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner.calibration import fit_least_squares
from embodiedreamer_gym.recordings import Recording, Recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate

NOISE = 4e-4  # rad


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> RobotModel:
    """A two-link arm in the vertical plane, its gains known to 20 %."""
    folder = tmp_path_factory.mktemp("arm")
    link = (
        '<link name="{0}"><inertial><origin xyz="0.15 0 0"/><mass value="{1}"/>'
        '<inertia ixx="0.002" iyy="0.008" izz="0.008" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="10"/></joint>'
    )
    text = '<robot name="two"><link name="base"/>' + link.format("upper", 1.5) + link.format("lower", 0.8)
    text += joint.format("shoulder", "base", "upper", 0) + joint.format("elbow", "upper", "lower", 0.3) + "</robot>"
    (folder / "two.urdf").write_text(text)
    (folder / "two.json").write_text(
        '{"robot": {"urdf": "two.urdf", "joints": ["shoulder", "elbow"]}, "rotor_inertia": [0.02, 0.01],'
        '"servo": {"stiffness": [90, 40], "damping": [4, 1.5]}, "viscous_friction": [0, 0], "effects": []}'
    )
    return RobotModel.load(folder / "two.json")


def record(truth: RobotModel, seed: int, speed: float, kind: str) -> Recording:
    """A noisy recording of a multisine, 3 s at 100 Hz, from rest: the arm has sagged for 1 s before."""
    rng = np.random.default_rng(seed)
    time = np.arange(-100, 300) / 100.0
    command = np.zeros((len(time), 2))
    for frequency in (0.3, 0.7, 1.3):
        for j in range(2):
            phase = rng.uniform(0, 2 * np.pi)
            command[:, j] += 0.3 * np.sin(2 * np.pi * speed * frequency * time + phase) - 0.3 * np.sin(phase)
    command *= np.clip(time / 0.5, 0.0, 1.0)[:, None]
    known = {"noise": np.full(2, NOISE), "quantum": np.zeros(2), "command_hold": "linear", "kind": kind}
    blank = Recording(f"{kind}-{seed}", truth.joints, time, command, command, **known)
    position = simulate(truth, blank).position + NOISE * rng.standard_normal(command.shape)
    return Recording(f"{kind}-{seed}", truth.joints, time[100:], position[100:], command[100:], **known)


def logs(truth: RobotModel) -> tuple[Recordings, Recordings]:
    """Two recordings to learn from and two, slower, to judge by."""
    truth = truth.with_(stiffness=truth.stiffness * 1.2, damping=truth.damping * 0.85)
    return (
        Recordings([record(truth, k, 1.0, "fast") for k in (1, 2)]),
        Recordings([record(truth, k, 0.6, "slow") for k in (3, 4)]),
    )


def test_a_faultless_arm_is_not_accused(model) -> None:
    found = diagnose(model, *logs(model), jobs=1)
    assert found.verdict == "nothing_missing"
    assert found.effects == () and found.best is None
    assert found.error["with_effect"] is None
    assert found.error["calibrated"] < 1.1 * found.error["noise"] < found.error["nominal"]
    assert found.as_dict()["error"]["unit"] == "rad"


@pytest.fixture(scope="module")
def friction(model):
    """Recordings of the arm with dry friction in its elbow, and the diagnosis."""
    truth = model.with_effect("coulomb_friction").with_values({"coulomb_friction.torque": {"elbow": 0.4}})
    train, test = logs(truth)
    return train, test, diagnose(model, train, test, jobs=1)


def test_the_missing_effect_is_named_on_its_joint(friction) -> None:
    found = friction[2]
    assert found.verdict == "missing"
    assert found.effects == ("coulomb_friction",)
    assert found.joints == {"coulomb_friction": ("elbow",)}
    row = found.parameters["coulomb_friction"]["elbow"]
    assert row["unit"] == "N m" and row["low"] <= row["value"] <= row["high"]
    assert row["value"] == pytest.approx(0.4, rel=0.05)


def test_the_error_falls_to_the_noise(friction) -> None:
    found = friction[2]
    assert found.error["with_effect"] < 1.1 * found.error["noise"] < 0.5 * found.error["calibrated"]
    assert [label for label, _ in found.steps] == ["nominal", "calibrated", "+ coulomb_friction"]
    assert found.end_effector_mm["with_effect"] < found.end_effector_mm["calibrated"]
    assert found.ranking[0].gain > found.ranking[-1].gain
    assert "coulomb_friction" in str(found)


def test_the_better_model_survives_its_file_and_does_as_well(friction, tmp_path) -> None:
    _, test, found = friction
    found.model.with_(urdf=found.model.urdf).save(tmp_path / "better.json")
    again = evaluate(RobotModel.load(tmp_path / "better.json"), test)
    assert again.error == pytest.approx(found.error["with_effect"], abs=1e-7)
    without = evaluate(RobotModel.load(tmp_path / "better.json").without_effect("coulomb_friction"), test)
    assert without.error > 2 * again.error


@pytest.mark.release
def test_an_effect_outside_the_catalogue_is_unknown_and_a_users_own_is_found(model) -> None:
    class Wind(SignalLaw):
        """A torque that swings with time."""

        name, stage = "wind", "load"
        parameters = (Parameter("torque", "N m", off=0.0, low=-5.0, high=5.0, typical=0.5),)
        symptom = reveals = "time"

        @staticmethod
        def law(signal, joint, memory, p):
            return signal + p.torque * np.sin(4 * np.pi * joint.time), memory

    blown = model.with_effect(Wind).with_values({"wind.torque": {"elbow": 0.6, "shoulder": 0.8}})
    train, test = logs(blown)
    found = diagnose(model, train, test, jobs=1)
    assert found.verdict == "unknown"
    assert found.effects == () and found.error["with_effect"] is None
    known = diagnose(model, train, test, catalogue={**model.catalogue, "wind": Wind}, jobs=1)
    assert known.verdict == "missing" and known.effects == ("wind",)
    assert known.parameters["wind"]["elbow"]["value"] == pytest.approx(0.6, rel=0.15)


def test_add_effect_shows_before_and_after(friction, model) -> None:
    train, test, _ = friction
    added = add_effect(model, "coulomb_friction", train, test)
    assert added.comparison.error[1] < 0.5 * added.comparison.error[0]
    assert added.after.model.effects[0].name == "coulomb_friction"


def test_held_out_recordings_are_needed(model) -> None:
    train, _ = logs(model)
    with pytest.raises(CalibrationError, match="held-out recordings"):
        diagnose(model, train, Recordings([]))


def test_wrong_masses_are_no_alarm_but_are_expected(model) -> None:
    train, test = logs(model)
    problem, fit = fit_least_squares(model, train)
    null = draw_null(problem.model_at(fit.x), fit, problem, test, np.random.default_rng(0))
    assert np.all(null.chi2 > 0.5) and 1.0 < np.median(null.chi2) < 2.0
    assert np.all(null.trained_chi2 > 0.5) and null.moves.all()
    ordinary, trained = np.median(null.chi2, axis=0), np.median(null.trained_chi2, axis=0)
    zero = np.zeros_like(ordinary)
    assert null.p_value(zero, zero) == 1.0
    assert null.p_value(ordinary, trained) > 0.2
    assert null.p_value(np.full_like(ordinary, 1e9), trained) == pytest.approx(3 / (1 + len(null.chi2)))
    one_bad = ordinary.copy()
    one_bad[0] = 10 * null.chi2[:, 0].max()
    assert null.p_value(one_bad, trained) < 0.01, (
        "one joint far out of its range is as good a reason for an alarm as all"
    )
    fitted_badly = trained.copy()
    fitted_badly[0] = 10 * null.trained_chi2[:, 0].max()
    assert null.p_value(ordinary, fitted_badly) < 0.01, "so is one that the fit to the training motion leaves"
    assert null.excess(ordinary, trained) < 1.0 < 5.0 < null.excess(ordinary, fitted_badly)
    worst = np.array([null.excess(held, fitted) for held, fitted in zip(null.chi2, null.trained_chi2, strict=True)])
    assert np.mean(worst > 1.0) == pytest.approx(0.05, abs=0.01), "one is the 95 % quantile of the worst"


def held(chi2: np.ndarray, spread: float = 0.0, seed: int = 0) -> HeldOut:
    """A HeldOut of 12 pieces of 100 samples whose chi2 vary by `spread`."""
    noise = 1 + spread * np.random.default_rng(seed).standard_normal((12, len(chi2)))
    blocks = 100 * chi2 * np.abs(noise)
    return HeldOut(blocks.sum(0) / 1200, np.ones(len(chi2)), blocks, np.full((12, len(chi2)), 100))


def test_score_counts_nothing_below_the_noise() -> None:
    assert score(np.array([0.5, np.e]), np.ones(2)) == pytest.approx(1.0)


def test_a_model_that_claims_more_noise_scores_no_better() -> None:
    """Errors twice as large in units of a noise half as large are the same errors."""
    assert score(np.array([4.0, 16.0]), np.full(2, 0.5)) == pytest.approx(score(np.array([1.0, 4.0]), np.ones(2)))


def test_a_gain_needs_to_be_larger_than_its_accidents() -> None:
    before, after = held(np.array([9.0, 1.0])), held(np.array([3.0, 1.0]))
    assert gain(before, after)[0] == pytest.approx(np.log(3.0))
    assert improves(before, after) and not improves(after, before)
    assert not improves(held(np.array([3.2, 1.0]), 0.9, 1), held(np.array([3.0, 1.0]), 0.9, 2))


def test_explained_is_a_share_of_the_excess() -> None:
    null = np.ones((50, 3)) + 0.01 * np.random.default_rng(0).random((50, 3))
    before, after = held(np.array([11.0, 5.0, 1.0])), held(np.array([1.0, 5.0, 1.0]))
    share = explained(before, after, null)
    assert share[0] == pytest.approx(1.0, abs=0.02) and share[1] == 0.0 and np.isnan(share[2])
    share = total_explained(before, after, null)
    assert 0.5 < share < 0.7
    assert total_explainable(before, after, null, np.zeros(3)) == share, "what effects explain is explainable"
    assert total_explainable(before, after, null, np.array([0.0, 1.0, 0.0])) == pytest.approx(1.0, abs=0.01)
    assert total_explainable(before, after, null, np.array([0.0, 0.0, 1.0])) == share, (
        "a joint without excess is no matter"
    )


def test_the_special_case_goes_before_the_richer_law() -> None:
    class Fake:
        def __init__(self, name: str, chi2: float) -> None:
            self.kind = CATALOGUE[name]
            self.held_out, self.trained_score = held(np.array([chi2])), float(np.log(chi2))

    before = held(np.array([99.0]))
    close = contenders(before, [Fake("stribeck_friction", 1.50), Fake("coulomb_friction", 1.52), Fake("payload", 9.0)])  # type: ignore[list-item]
    assert [c.kind.name for c in close] == ["coulomb_friction"]
    tie = contenders(before, [Fake("torque_bias", 1.50), Fake("encoder_offset", 1.52)])  # type: ignore[list-item]
    assert len(tie) == 2


@pytest.mark.slow
def test_two_effects_are_named_on_their_joints(model) -> None:
    """A delay of the command and dry friction of the elbow, one after the other, and the error ends at the noise."""
    truth = model.with_effect("command_delay").with_effect("coulomb_friction")
    delays = {"shoulder": 0.03, "elbow": 0.03}
    truth = truth.with_values({"command_delay.seconds": delays, "coulomb_friction.torque": {"elbow": 0.4}})
    train, test = logs(truth)
    found = diagnose(model, train, test, jobs=1)
    assert found.verdict == "missing"
    assert set(found.effects) == {"command_delay", "coulomb_friction"}
    assert found.joints == {"command_delay": ("shoulder", "elbow"), "coulomb_friction": ("elbow",)}
    assert found.parameters["command_delay"]["elbow"]["value"] == pytest.approx(0.03, rel=0.1)
    assert found.error["with_effect"] < 1.1 * found.error["noise"]


@pytest.fixture
def faultless_null() -> np.ndarray:
    """chi2 (200, 3) of faultless robots, between 1 and 1.1."""
    return 1.0 + 0.1 * np.random.default_rng(0).random((200, 3))


@pytest.mark.parametrize(
    ("before", "after", "sure"),
    [
        pytest.param([40.0, 1.0, 1.0], [1.1, 1.0, 1.0], True, id="nothing left"),
        pytest.param([40.0, 1.0, 1.0], [2.0, 1.0, 1.0], True, id="a fortieth left"),
        pytest.param(
            [900.0, 400.0, 90.0], [800.0, 10.0, 4.0], False, id="no joint near the noise, the worst hardly better"
        ),
        pytest.param([9.0, 1.0, 1.0], [2.5, 1.0, 1.0], False, id="a fifth left, and others reach the noise"),
        pytest.param([9.0, 9.0, 1.0], [1.0, 8.0, 1.0], False, id="one joint mended of two"),
        pytest.param([900.0, 400.0, 90.0], [200.0, 60.0, 20.0], True, id="no joint near the noise, most explained"),
        pytest.param([900.0, 400.0, 90.0], [800.0, 300.0, 80.0], False, id="no joint near the noise, little explained"),
        pytest.param([900.0, 400.0, 90.0], [4.0, 4.0, 2.8], True, id="nearer than that, one joint less far"),
        pytest.param([900.0, 400.0, 90.0], [2.5, 2.5, 2.5], True, id="all joints nearer than far"),
        pytest.param([5.0, 5.0, 5.0], [2.5, 2.5, 2.5], False, id="nearer than far, of little excess"),
    ],
)
def test_what_is_named_leaves_no_more_than_a_faultless_robot_has(before, after, sure, faultless_null) -> None:
    """Or next to nothing of what there was; where no joint comes near its noise most is enough."""
    pair = held(np.array(before)), held(np.array(after))
    assert is_convincing(*pair, faultless_null) is sure


def test_a_joint_out_of_its_range_asks_for_another_effect(faultless_null) -> None:
    assert not leaves_excess(held(np.array([1.1, 1.0, 1.05])), faultless_null)
    assert leaves_excess(held(np.array([1.1, 1.6, 1.05])), faultless_null)


def test_an_effect_that_others_make_needless_is_dropped(model) -> None:
    """Torque bias beside the payload that truly is there: without the bias the motion is as well explained."""
    truth = model.with_effect("payload").with_values({"payload.mass": {model.arms[0]: 0.3}})
    train, test = logs(truth)
    fits = added(model, ("torque_bias", "payload"), train, test)
    kept = drop_redundant(fits, train, test)
    assert [step.kind.name for step in kept] == ["payload"]
    assert [effect.name for effect in kept[-1].model.effects] == ["payload"]
    assert kept[-1].held_out.score < fits[-1].held_out.score + 0.1


def added(model, names, train, test) -> list[Candidate]:
    """A candidate for each effect, added one after the other."""
    fits = []
    for name in names:
        model = model.with_effect(name)
        problem, fit = fit_least_squares(model, train)
        fitted = problem.model_at(fit.x)
        held_out = evaluate(fitted, test, problem.hold)
        fits.append(Candidate(CATALOGUE[name], fitted, problem, fit, held_out, problem.rollouts))
    return fits


def test_the_last_effect_is_dropped_where_the_held_out_error_does_not_fall_by_it(model) -> None:
    """After the payload that truly is there a bias brings nothing; of a robot without faults nothing stays."""
    truth = model.with_effect("payload").with_values({"payload.mass": {model.arms[0]: 0.3}})
    train, test = logs(truth)
    fits = added(model, ("payload", "torque_bias"), train, test)
    before = evaluate(model, test)
    kept = drop_last(before, fits, train, test)
    assert [step.kind.name for step in kept] == ["payload"]
    assert [effect.name for effect in kept[-1].model.effects] == ["payload"]
    assert kept[-1].held_out.error < before.error
    assert drop_last(before, kept, train, test)[0] is kept[0]
    train, test = logs(model)
    problem, fit = fit_least_squares(model, train)
    assert (
        drop_last(evaluate(problem.model_at(fit.x), test), added(model, ("torque_bias",), train, test), train, test)
        == []
    )
