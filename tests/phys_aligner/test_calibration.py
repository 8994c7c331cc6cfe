from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from embodiedreamer_gym.errors import CalibrationError, ModelError, SimulationError
from embodiedreamer_gym.phys_aligner import METHODS, calibrate
from embodiedreamer_gym.phys_aligner.searches import SEARCHES
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate

NOISE = 5e-4
FITTED = ("stiffness", "damping", "coulomb_friction")


def values(model: RobotModel) -> np.ndarray:
    return model.parameters().select(*FITTED).values


def widths(model: RobotModel) -> np.ndarray:
    return np.array([r.interval[1] - r.interval[0] for r in model.parameters().select(*FITTED) if r.interval])


@pytest.fixture(scope="module")
def fit(start, record):
    return calibrate(start, [record(1)])


def test_known_values_are_found_again(fit, truth, record) -> None:
    assert np.abs(values(fit.model) / values(truth) - 1).max() < 0.05
    assert fit.converged and fit.undetermined == ()
    assert fit.error == pytest.approx(NOISE, rel=0.1)
    clean = record(7, noise=0.0)
    held_out = simulate(fit.model, clean).position - clean.position
    assert np.sqrt(np.mean(held_out**2)) < 1.5e-4


def test_the_intervals_hold_the_truth(fit, truth) -> None:
    rows = fit.model.parameters().select(*FITTED)
    inside = [r.interval[0] <= v <= r.interval[1] for r, v in zip(rows, values(truth), strict=True)]
    assert sum(inside) >= 5  # of 6
    assert np.all(widths(fit.model) < 0.3 * values(truth))


def test_the_result_is_the_same_every_time_and_writes_itself(fit, start, record) -> None:
    again = calibrate(start, [record(1)])
    assert np.array_equal(values(again.model), values(fit.model))
    data = json.loads(json.dumps(fit.as_dict()))
    assert data["rollouts"] == fit.rollouts and data["parameters"]["stiffness[elbow]"]["unit"] == "N m/rad"
    assert "stiffness[shoulder]" in str(fit) and "rollouts" in str(fit)


def test_several_recordings_narrow_the_intervals(fit, start, record) -> None:
    both = calibrate(start, [record(1), record(2, seconds=4.0)])
    assert np.median(widths(both.model) / widths(fit.model)) < 0.9


@pytest.mark.parametrize("rule", ["linear", "hold"])
def test_an_unknown_rule_between_commands_is_found(start, record, rule: str) -> None:
    found = calibrate(start, [record(3, rate=25.0, rule=rule, declared="unknown")])
    assert found.model.command_hold == rule
    assert f"rule between two commands: {rule}" in str(found)


def test_gains_that_the_file_leaves_out_are_found(folder, truth, record) -> None:
    minimal = {
        "robot": {"urdf": "two.urdf", "joints": ["shoulder", "elbow"]},
        "effects": [{"name": "coulomb_friction", "torque": 0.2}],
    }
    (folder / "minimal.json").write_text(json.dumps(minimal))
    found = calibrate(RobotModel.load(folder / "minimal.json"), [record(1), record(2)])
    assert np.abs(values(found.model) / values(truth) - 1).max() < 0.15
    assert any(row.name == "rotor_inertia[elbow]" for row in found.problem.rows)


def test_outliers_hardly_move_the_estimate(fit, start, truth, record) -> None:
    clean = record(1)
    rng = np.random.default_rng(0)
    hit = rng.random(clean.position.shape) < 0.05
    hit[:5] = False  # the first samples say where the arm starts
    spoilt = clean.with_(position=clean.position + 0.05 * hit * rng.choice([-1, 1], hit.shape))
    found = calibrate(start, [spoilt])
    assert np.abs(values(found.model) / values(fit.model) - 1).max() < 0.05


def test_samples_that_are_not_usable_do_not_count(fit, start, record) -> None:
    clean = record(1)
    usable = np.ones(clean.position.shape, bool)
    usable[100:140] = False
    spoilt = np.where(usable, clean.position, 1.0)
    found = calibrate(start, [clean.with_(position=spoilt, usable=usable)])
    assert np.abs(values(found.model) / values(fit.model) - 1).max() < 0.1


def test_coloured_noise_widens_the_intervals(start, record) -> None:
    white = np.random.default_rng(5).standard_normal((251, 2))
    coloured = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], white, axis=0)
    plain = calibrate(start, [record(1, noise=NOISE * white)])
    wide = calibrate(start, [record(1, noise=NOISE * coloured)])
    assert np.median(widths(wide.model) / widths(plain.model)) > 1.5


def test_a_motionless_log_determines_no_damping(start, record, truth) -> None:
    log = record(1)
    still = np.tile(log.position[:1], (len(log.time), 1))
    noise = NOISE * np.random.default_rng(0).standard_normal(still.shape)
    command = np.tile(log.command[:1], (len(log.time), 1))
    found = calibrate(start, [log.with_(position=still + noise, command=command)])
    assert {"damping[shoulder]", "damping[elbow]"} <= set(found.undetermined)


def test_a_budget_is_kept(start, record) -> None:
    assert calibrate(start, [record(1)], budget=40).rollouts <= 40


def test_a_value_outside_its_bounds_is_an_error(truth) -> None:
    with pytest.raises(ModelError, match="outside its bounds"):
        truth.with_values({"coulomb_friction.torque": {"elbow": 1e4}})


def test_a_start_outside_the_bounds_is_an_error(start, record, monkeypatch) -> None:
    low, high = np.array([300.0, 300.0]), np.array([900.0, 900.0])
    bounds = RobotModel.servo_bounds

    def narrow(self, group):
        return (low, high) if group == "stiffness" else bounds(self, group)

    monkeypatch.setattr(RobotModel, "servo_bounds", narrow)
    with pytest.raises(CalibrationError, match=r"stiffness\[shoulder\] starts at 100, outside its bounds 300"):
        calibrate(start, [record(1)])


def test_another_robots_recording_is_an_error(start, record) -> None:
    with pytest.raises(SimulationError, match="hip, elbow"):
        calibrate(start, [record(1).with_(joints=("hip", "elbow"))])


def test_a_recording_without_command_is_an_error(start, record) -> None:
    with pytest.raises(SimulationError, match="neither a command nor an effort"):
        calibrate(start, [record(1).with_(command=None)])


def test_wrong_requests_are_errors_that_list_the_choices(start, record) -> None:
    with pytest.raises(CalibrationError, match="annealing-scaled"):
        calibrate(start, [record(1)], method="guess")
    with pytest.raises(CalibrationError, match="no recording is left"):
        calibrate(start, [])
    with pytest.raises(CalibrationError, match="no free parameter"):
        calibrate(start, [record(1)], groups=["joint_spring"])
    blind = np.zeros(record(1).position.shape, bool)
    with pytest.raises(CalibrationError, match="too few usable samples"):
        calibrate(start, [record(1).with_(usable=blind)])


def test_every_method_has_its_search() -> None:
    assert {"least-squares", *SEARCHES} == set(METHODS)
