from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import compare
from embodiedreamer_gym.diagnosis.compare import effort_scale
from embodiedreamer_gym.errors import RecordingError, SimulationError
from embodiedreamer_gym.io.tables import layout, number
from embodiedreamer_gym.recordings import noise_floor
from tests.two_joint_arm import load_arm, record


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def shifted(recording, by: float):
    return recording.with_(position=recording.position + by)


def test_a_model_held_against_its_own_recordings_has_no_error(arm) -> None:
    found = compare(arm, [record(arm)])
    assert found.error[0] < 1e-9 and found.end_effector_mm[0] < 1e-6
    assert found.rows(signal="effort", regime="all")[0].rms < 1e-9


def test_noise_is_what_is_left_of_a_faultless_model(arm) -> None:
    found = compare(arm, [record(arm, noise=1e-3, seed=s) for s in range(2)])
    assert found.error[0] == pytest.approx(1e-3, rel=0.05)
    assert found.noise == pytest.approx(1e-3)
    assert found.joint_chi2[0] == pytest.approx([1, 1], abs=0.1)


def test_a_known_offset_gives_known_numbers(arm) -> None:
    log = record(arm)
    found = compare(arm, [log.with_(position=log.position + np.array([0.0, 0.003]))])
    assert found.joint_rms[0, 1] == pytest.approx(0.003, rel=0.2)  # it starts at the offset and creeps back


def test_samples_that_are_not_usable_do_not_count(arm) -> None:
    log = record(arm)
    bad = np.zeros(log.position.shape, bool)
    bad[200:260, 0] = True
    position = log.position.copy()
    position[bad] += 0.5
    kept = log.with_(position=position, usable=~bad)
    found = compare(arm, [kept])
    assert found.error[0] < 1e-9
    assert found.rows(regime="all")[0].samples == (~bad[:, 0]).sum()
    assert found.end_effector_mm[0] < 1e-6


def test_a_joint_without_usable_samples_is_left_out_of_the_mean(arm) -> None:
    log = record(arm, noise=1e-3)
    usable = np.ones(log.position.shape, bool)
    usable[:, 0] = False
    found = compare(arm, [log.with_(usable=usable)])
    assert np.isnan(found.joint_rms[0, 0]) and found.error[0] == found.joint_rms[0, 1]
    json.dumps(found.as_dict(), allow_nan=False)
    assert "-" in str(found)


def test_regimes_together_hold_all_samples(arm) -> None:
    found = compare(arm, [record(arm, noise=1e-3)])
    for joint in found.joints:
        count = {r.regime: r.samples for r in found.rows() if r.joint == joint}
        assert sum(count.get(k, 0) for k in ("hold", "slow", "fast")) == count["all"]


def test_effort_of_unknown_unit_is_scaled(arm) -> None:
    found = compare(arm, [record(arm)])
    assert effort_scale(found.recordings, found.rollouts[0]) == pytest.approx([2.0, 2.0])


def test_two_models_before_and_after(arm) -> None:
    delayed = arm.with_effect("command_delay").with_values({"command_delay.seconds": {"shoulder": 0.03}})
    found = compare([arm, delayed], [record(delayed, noise=5e-4)])
    assert found.labels == ("two", "two + command_delay")
    assert found.error[0] > 5 * found.error[1]
    assert found.joint_rms[0, 0] > 0.01 and found.joint_rms[1, 0] == pytest.approx(5e-4, rel=0.1)
    assert found.end_effector_mm[0] > 1 > found.end_effector_mm[1]
    before, after = (found.rows(model, signal="servo", regime="all")[0].chi2 for model in range(2))
    assert before > 10 > 2 > after
    assert found.trajectory[0, 0] == pytest.approx(found.end_effector_mm[0] / 1e3)


def test_models_of_one_name_get_labels_of_their_own(arm) -> None:
    assert compare([arm, arm, arm], [record(arm)]).labels == ("two", "two (2)", "two (3)")
    assert compare([arm, arm], [record(arm)], labels=("a", "b")).labels == ("a", "b")


def test_a_joint_that_stands_still_in_a_log_does_not_lower_the_noise_floor() -> None:
    assert noise_floor([np.array([1e-3, 2e-3]), np.array([0.0, 2e-3])]) == pytest.approx([1e-3, 2e-3])
    assert noise_floor([np.zeros(2)]) == pytest.approx(1e-5)


def test_json_and_table(arm) -> None:
    found = compare(arm, [record(arm, noise=1e-3)])
    data = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert data["error"]["unit"] == "rad" and data["error"]["of"]["two"] == pytest.approx(found.error[0])
    assert {row["signal"] for row in data["table"]} == {"position", "effort", "servo"}
    text = str(found)
    assert "shoulder" in text and "reversal" in text and max(map(len, text.splitlines())) <= 110
    assert repr(found) == "Comparison(1 models, 1 recordings, n=2)"


def test_nothing_to_compare_is_an_error(arm) -> None:
    with pytest.raises(RecordingError, match="nothing to compare"):
        compare(arm, [])
    log = record(arm)
    with pytest.raises(RecordingError, match="no usable sample"):
        compare(arm, [log.with_(usable=np.zeros(log.position.shape, bool))])


def test_a_recording_of_another_robot_is_an_error(arm) -> None:
    log = record(arm)
    with pytest.raises(SimulationError, match="wrist"):
        compare(arm, [log.with_(joints=("shoulder", "wrist"))])


def test_a_model_that_diverges_is_said_to(arm) -> None:
    wild = arm.with_(stiffness=arm.stiffness * -0.0 + 1e7, damping=arm.damping * 0.0)
    found = compare([arm, wild], [record(arm)])
    assert not found.diverged[0] and np.isfinite(found.error).all()


def test_long_names_wrap() -> None:
    text = layout(["joint", "rms"], [["x" * 300, "1.0"], ["y", "22.0"]])
    lines = text.splitlines()
    assert max(map(len, lines)) <= 110 and sum(line.count("x") for line in lines) == 300
    assert lines[1].endswith("1.0") and lines[-1].endswith("22.0")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1.0, "1.00"), (12.345, "12.3"), (123456.0, "123456"), (1e-7, "1.00e-07"), (None, "-"),
     (float("nan"), "-")],
)  # fmt: skip
def test_numbers_are_readable(value, text) -> None:
    assert number(value) == text
