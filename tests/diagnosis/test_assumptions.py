"""What is assumed is said: guessed gains, a rank that differs from the verdict, an effect that makes the model worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import Addition, add_effect, compare, error_breakdown
from embodiedreamer_gym.diagnosis.comparison import gains_are_guessed
from embodiedreamer_gym.diagnosis.report import write_report
from embodiedreamer_gym.diagnosis.report.error_figures import overlay, worst_joints
from embodiedreamer_gym.diagnosis.verdict import rank_notes
from embodiedreamer_gym.effects import CATALOGUE
from tests.diagnosis.test_report import answer, opened
from tests.two_joint_arm import load_arm, record

GUESSED = "gains guessed, not yours"


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def guessed(arm):
    """The arm as it is loaded from a file without servo gains."""
    gains = {group: arm.first_guess()[group] for group in ("stiffness", "damping")}
    return arm.with_(given=arm.given - set(gains), **gains)


@pytest.fixture(scope="module")
def logs(arm):
    return [record(arm, f"wave_{s}", 5e-4, seed=s) for s in range(2)]


def test_gains_are_guessed_until_they_are_stated_or_fitted(arm, guessed) -> None:
    assert gains_are_guessed(guessed) and not gains_are_guessed(arm)
    fitted = guessed.with_values({
        group: {joint: 1.1 * value for joint, value in zip(arm.joints, getattr(guessed, group), strict=True)}
        for group in ("stiffness", "damping")
    })  # fmt: skip
    assert not gains_are_guessed(fitted)


def test_a_comparison_marks_the_model_with_guessed_gains(arm, guessed, logs) -> None:
    both = compare([guessed, arm], logs, labels=("nominal", "mine"))
    assert f"nominal ({GUESSED})" in str(both) and str(both).count(GUESSED) == 1
    assert both.as_dict()["gains_guessed"] == ["nominal"] == list(both.gains_guessed)
    assert GUESSED not in str(compare(arm, logs)) and "gains_guessed" not in compare(arm, logs).as_dict()
    assert GUESSED in str(error_breakdown(guessed, logs)) and GUESSED not in str(error_breakdown(arm, logs))


def test_a_diagnosis_and_its_report_say_that_gains_are_guessed(arm, guessed, logs, tmp_path) -> None:
    delayed = arm.with_effect("command_delay").with_values({"command_delay.seconds": {"shoulder": 0.03}})
    found = replace(answer(arm, delayed), nominal=guessed)
    assert f"nominal ({GUESSED})" in str(found) and found.as_dict()["gains_guessed"]
    page = opened(write_report(tmp_path, diagnosis=found, recordings=logs))
    assert f"nominal ({GUESSED})" in page.text and "judge by the\ncalibrated model" in page.text
    sure = answer(arm, delayed)
    assert GUESSED not in str(sure) and not sure.as_dict()["gains_guessed"]
    assert GUESSED not in opened(write_report(tmp_path, diagnosis=sure, recordings=logs)).text


def test_pictures_show_calibrated_beside_final_for_the_joints_at_fault_first(arm, guessed, logs) -> None:
    heavy = arm.with_(rotor_inertia=arm.rotor_inertia * np.array([1.0, 3.0]))
    both = compare([guessed, heavy, arm], logs, labels=("nominal", "calibrated", "final"))
    worst = worst_joints(both, 1)
    best = both.joints[worst[-1]]
    assert worst_joints(both, 1, (best,)) == worst[::-1]
    labels = [text.get_text() for text in overlay(both, worst, 1).legends[0].get_texts()]
    assert labels == ["measured", "calibrated", "final", "noise (±2 sd)"]


def test_a_page_of_a_diagnosis_compares_with_the_calibrated_model(arm, guessed, logs, tmp_path) -> None:
    delayed = arm.with_effect("command_delay").with_values({"command_delay.seconds": {"shoulder": 0.03}})
    found = replace(answer(arm, delayed), nominal=guessed)
    page = opened(write_report(tmp_path, diagnosis=found, recordings=logs))
    assert "Change: from calibrated to with command delay." in page.text


def test_a_rank_against_the_verdict_says_why() -> None:
    ranked = ["stribeck_friction", "coulomb_friction", "payload"]
    notes = rank_notes(ranked, [5.05, 5.0, 0.1], ["coulomb_friction"], CATALOGUE)
    assert notes == ["contains coulomb_friction as a special case and lowers the score by only 0.05 more", "", ""]
    assert rank_notes(ranked, [5.05, 5.0, 0.1], ["stribeck_friction"], CATALOGUE) == ["", "", ""]
    assert rank_notes(ranked, [5.05, 5.0, 0.1], [], CATALOGUE) == ["", "", ""]
    assert "fits the training motion worse" in rank_notes(ranked, [5.0, 4.9, 4.8], ["payload"], CATALOGUE)[0]
    both = rank_notes(ranked, [5.0, 4.9, 4.8], ["payload", "command_delay"], CATALOGUE)
    assert "not together with the other effects" in both[1] and both[2] == ""


def test_the_reason_stands_in_table_page_and_json(arm, tmp_path) -> None:
    delayed = arm.with_effect("command_delay")
    found = answer(arm, delayed)
    first = replace(found.ranking[1], held_out_chi2=1.0, note="contains command_delay as a special case")
    found = replace(found, ranking=(first, found.ranking[0]))
    assert "not named: contains command_delay" in str(found)
    assert found.as_dict()["ranking"][0]["note"] == first.note
    page = opened(write_report(tmp_path, diagnosis=found))
    assert page.text.count(first.note) == 2  # below the picture and in the table


def test_add_says_that_the_held_out_error_rose(arm, logs) -> None:
    added = add_effect(arm, "command_delay", logs[:1], logs[1:])
    rose = replace(added, comparison=compare([arm, arm.with_(stiffness=0.5 * arm.stiffness)], logs))
    assert isinstance(rose, Addition)
    assert (
        rose.warning.startswith("The held-out error rose from ")
        and "command_delay makes this model worse" in rose.warning
    )
    assert str(rose).endswith(rose.warning) and rose.as_dict()["held_out_error_rose"] is True
    fell = replace(added, comparison=compare([arm.with_(stiffness=0.5 * arm.stiffness), arm], logs))
    assert fell.warning == "" and "rose" not in str(fell) and fell.as_dict()["held_out_error_rose"] is False
