"""What logs without commands are fitted with beside the effects, and what their verdicts are held against."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.diagnosis import compare, diagnose
from embodiedreamer_gym.diagnosis.coupled_motors import SHARE, coupled_joints, coupling_notes
from embodiedreamer_gym.diagnosis.explainable import explainable_chi2
from embodiedreamer_gym.diagnosis.held_out import evaluate
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.load_friction import LoadFriction
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.phys_aligner import calibrate
from embodiedreamer_gym.phys_aligner.calibration import fit_least_squares, with_nuisances
from embodiedreamer_gym.phys_aligner.evidence import log_evidence
from embodiedreamer_gym.phys_aligner.linear_baseline import least_squares_rms
from embodiedreamer_gym.recordings import Recordings, load_recordings, smooth_motion
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import draw_case
from embodiedreamer_gym.standin.labels import draw_at_rest

SCALE, OFFSET = np.array([0.3, 0.5, 0.2, 0.7, 0.9, 2.0]), np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.05])


def case(effect: str | None, folder, seed: int = 1, **options):
    """A stand-in arm's model, and its logs without commands."""
    drawn = draw_case(effect, "arm6", np.random.default_rng([seed, 7]), with_command=False, **options)
    model = RobotModel.load(drawn.write(folder))
    return model, *(Recordings(load_recordings(folder / part)) for part in ("train", "test"))


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return case(None, tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory):
    return case("coulomb_friction", tmp_path_factory.mktemp("rubbing"))


def test_a_delay_of_the_effort_is_found(plain) -> None:
    """Efforts that are logged three samples late leave the same error, since the delay is estimated."""
    model, train, _ = plain
    known = model.with_fixed("urdf", "rotor_inertia")
    here = calibrate(known, train)
    late = [r.with_(effort=np.concatenate([r.effort[:1]] * 3 + [r.effort[:-3]])) for r in train]
    there = calibrate(known, late)
    rows = [c.model.parameters()["effort_sensor.delay[tip]"].value for c in (here, there)]
    assert rows[1] - rows[0] == pytest.approx(3 / train[0].hz, rel=0.1)
    assert there.error < 1.2 * here.error


@pytest.mark.release
def test_a_simple_law_on_wrong_masses_is_not_called_a_richer_one(tmp_path) -> None:
    """A friction that depends on the direction is a simple one and an offset, which stands in for masses that are a little off."""
    drawn = draw_at_rest(("coulomb_friction",), "arm6", np.random.default_rng([20011, 4, 2]), 0.41,
                         seconds=6.0, with_velocity=False, with_command=False)  # fmt: skip
    model = RobotModel.load(drawn.write(tmp_path))
    found = diagnose(model, *(load_recordings(tmp_path / part) for part in ("train", "test")), jobs=1)
    assert found.effects == ("coulomb_friction",)
    assert set(found.joints["coulomb_friction"]) == set(drawn.hidden["coulomb_friction"]["torque"])


def rubbed_wrist(log):
    """Efforts (T, n) of a log with 0.4 N m of dry friction more on joint 6."""
    return np.asarray(log.effort) + 0.4 * np.sign(smooth_motion(log).velocity) * np.eye(6)[5]


def test_coupled_motors_are_found_and_single_ones_are_not_suspected(rubbing) -> None:
    """A current of joint 5 that holds half of joint 6's."""
    model, train, test = rubbing
    mixing = np.eye(6)
    mixing[4, 5] = 0.5
    for matrix, expected in ((np.eye(6), []), (mixing, [("joint5", "joint6")])):
        logs = [[r.with_(effort=rubbed_wrist(r) @ matrix.T) for r in part] for part in (train, test)]
        rubbed = model.with_effect(CoulombFriction)
        found = coupled_joints(calibrate(rubbed, logs[0]).model, *logs)
        assert [(joint, other) for _, joint, other in found] == expected
        assert all(SHARE <= share <= 1 for share, _, _ in found)
        notes = coupling_notes(calibrate(rubbed, logs[0]).model, *logs)
        assert len(notes) == len(expected) and all("of joint5 follows the friction of joint6" in n for n in notes)


def test_scale_and_offset_of_an_effort_are_learnt_once(plain, tmp_path) -> None:
    """Learnt on the training logs, saved, and not fitted again on other logs; the offset is."""
    model, train, test = plain
    torques = calibrate(model, train).model
    train, test = ([r.with_(effort=np.asarray(r.effort) * SCALE + OFFSET, effort_unit="A") for r in logs]
                   for logs in (train, test))  # fmt: skip
    learnt = calibrate(model, train).model
    rows = learnt.parameters()
    scale = np.array([rows[f"effort_sensor.scale[{j}]"].value for j in model.joints])
    offset = np.array([rows[f"effort_sensor.offset[{j}]"].value for j in model.joints])
    before = np.array([torques.parameters()[f"effort_sensor.offset[{j}]"].value for j in model.joints])
    assert scale[:3] == pytest.approx(SCALE[:3], rel=0.05)
    for joint, truth in zip(model.joints, SCALE, strict=True):
        low, high = learnt.intervals[f"effort_sensor.scale[{joint}]"]
        assert low <= truth <= high
    assert offset == pytest.approx(OFFSET + SCALE * before, abs=0.1)
    learnt.save(tmp_path / "learnt.json")
    again = RobotModel.load(tmp_path / "learnt.json")
    assert "effort_sensor.scale" in again.fixed
    refitted = calibrate(again, test).model.parameters()
    assert [refitted[f"effort_sensor.scale[{j}]"].value for j in model.joints] == pytest.approx(scale.tolist())
    assert any(refitted[f"effort_sensor.offset[{j}]"].value != o for j, o in zip(model.joints, offset, strict=True))


def test_what_is_fixed_must_exist(plain, tmp_path) -> None:
    model = plain[0]
    model.with_(fixed=frozenset({"viscous_friction", "coulomb_friction"}))
    with pytest.raises(ModelError, match="fixed names 'weather'"):
        model.with_(fixed=frozenset({"weather"}))
    model.save(tmp_path / "m.json")
    data = json.loads((tmp_path / "m.json").read_text()) | {"urdf_error": {"mass": "much"}}
    (tmp_path / "m.json").write_text(json.dumps(data))
    with pytest.raises(ModelError, match="urdf_error: mass must be a number"):
        RobotModel.load(tmp_path / "m.json")


def test_viscous_friction_is_found_from_zero(plain) -> None:
    """A start of zero does not keep it there."""
    model, train, _ = plain
    found = calibrate(model.with_(viscous_friction=np.zeros(model.n)), train, groups=("viscous_friction",)).model
    assert found.viscous_friction[:3] == pytest.approx(model.viscous_friction[:3], rel=0.5)


def test_never_worse_than_plain_least_squares(rubbing) -> None:
    """With the same terms, Coulomb friction among them, on the same split; and with wrong masses far better."""
    model, train, test = rubbing
    baseline = np.mean(least_squares_rms(model, train, test))
    terms = with_nuisances(model, train).with_effect(CoulombFriction)
    problem, fit = fit_least_squares(terms, list(train))
    assert evaluate(problem.model_at(fit.x), list(test)).error < 1.02 * baseline


@pytest.mark.release
def test_a_diagnosis_shows_the_baseline_and_offsets(rubbing) -> None:
    """An offset of the effort is in the table with its interval, and does not spoil the verdict."""
    model, train, test = rubbing
    train, test = (Recordings(r.with_(effort=np.asarray(r.effort) + OFFSET) for r in logs) for logs in (train, test))
    found = diagnose(model, train, test, jobs=1)
    assert found.effects == ("coulomb_friction",)
    row = found.effort_offsets["joint1"]
    assert row["low"] <= 0.5 <= row["high"] and row["unit"] == "N m"
    assert "offset of the effort of joint1: 0.5" in str(found) or "offset of the effort of joint1: 0.4" in str(found)
    assert found.as_dict()["effort_offsets"] == found.effort_offsets
    assert found.error["least_squares"] == pytest.approx(np.mean(least_squares_rms(model, train, test)))
    assert "plain least squares" in str(found)
    assert not compare(model.with_(given=frozenset()), test).gains_guessed  # gains play no part
    assert found.as_dict()["error"]["with_effect"] <= 1.02 * found.error["least_squares"]


@pytest.mark.release
def test_unknown_keeps_the_closest_effect(tmp_path) -> None:
    """With friction out of the catalogue something close is found: kept with its values, and not named.

    Plain least squares, which has Coulomb friction, is far better than what it explains.
    """
    model, train, test = case("coulomb_friction", tmp_path, seed=3)
    found = diagnose(model, train, test, catalogue={"load_friction": LoadFriction}, jobs=1)
    assert (found.verdict, found.effects, found.closest) == ("unknown", (), ("load_friction",))
    assert found.parameters["load_friction"]
    assert found.error["with_effect"] < found.error["calibrated"]
    assert "load_friction" in [e.name for e in found.model.effects]
    assert "load_friction, explains" in found.sentence
    assert found.error["with_effect"] > 1.25 * found.error["least_squares"]


def test_a_regression_tells_how_much_is_explainable(rubbing, plain) -> None:
    """Friction is explainable nearly whole; of sensor noise nothing is."""
    model, train, test = rubbing
    base = evaluate(model, list(test)).chi2
    left = explainable_chi2(model, list(train), list(test))
    assert np.all(left <= base * (1 + 1e-9))
    assert left[1] < 0.2 * base[1]
    model, train, test = plain
    calibrated = calibrate(model, train).model
    base = evaluate(calibrated, list(test)).chi2
    assert np.all(explainable_chi2(calibrated, list(train), list(test)) > 0.6 * base)


def test_evidence_prefers_the_true_effect_and_none_too_many(rubbing, plain) -> None:
    """Friction that is there is far more probable than none; a payload that is not, is less so."""
    for (model, train, _), kind, most, least in (
        (rubbing, CoulombFriction, np.inf, 100.0),
        (plain, Payload, 0.0, -20.0),
    ):
        none = with_nuisances(model, train)
        with_effect, without = (
            log_evidence(*fit_least_squares(trial, list(train))) for trial in (none.with_effect(kind), none)
        )
        assert least < with_effect - without < most


def test_what_is_known_is_held_fixed(tmp_path, capsys) -> None:
    """A payload is found with gains and friction that an earlier test gave; nothing else changes."""
    rng = np.random.default_rng([1, 5])
    drawn = draw_case("payload", "arm6", rng, seconds=3.0)
    source = drawn.write(tmp_path)
    options = ["--model", str(source), "--train", str(tmp_path / "train"), "--test", str(tmp_path / "test"), "--quiet",
               "--fix", "gains, friction", "--jobs", "1", "--out", str(tmp_path / "better.json")]  # fmt: skip
    assert main(["add", "payload", *options]) == 0
    before, after = RobotModel.load(source), RobotModel.load(tmp_path / "better.json")
    assert after.stiffness.tolist() == before.stiffness.tolist() and after.damping.tolist() == before.damping.tolist()
    assert after.fixed == {"stiffness", "damping", "viscous_friction"}
    (truth,) = drawn.truth["values"]["mass"].values()
    assert after.parameters()["payload.mass[tip]"].value == pytest.approx(truth, rel=0.2)
    assert main(["add", "payload", *options[:-4], "--fix", "weather", "--out", str(tmp_path / "c.json")]) == 2
    assert "fixed names 'weather'" in capsys.readouterr().err
    for text, reason in (("1,2", "is not three numbers"), ("0,10,20", "mass must be a number above 0")):
        assert main(["add", "payload", *options, "--urdf-trust", text]) == 2
        assert reason in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 5, 10])
def test_an_arm_whose_urdf_is_ten_percent_off_is_not_accused(seed: int, tmp_path) -> None:
    """Masses 10 %, centres 10 mm off: they are estimated, and nothing is named."""
    logs = case(None, tmp_path, seed, imperfect={"mass_error": 0.1, "com_error": 0.01})
    assert diagnose(*logs, jobs=1).verdict == "nothing_missing"
