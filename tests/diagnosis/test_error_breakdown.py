from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import error_breakdown
from embodiedreamer_gym.effects import CATALOGUE
from tests.two_joint_arm import load_arm, record

NOISE = 5e-4


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def hidden(arm, effect: str, **values: list[float]):
    """The arm with an effect of these values on shoulder and elbow."""
    named = {f"{effect}.{key}": dict(zip(arm.joints, pair, strict=True)) for key, pair in values.items()}
    return arm.with_effect(effect).with_values(named)


def found_in(arm, truth, effort: bool = True):
    return error_breakdown(arm, [record(truth, f"wave_{s}", NOISE, seed=s, effort=effort) for s in range(2)])


def said(found, *words: str) -> bool:
    return any(all(word in sentence for word in words) for sentence in found.findings)


def test_a_faultless_model_is_at_the_noise_floor(arm) -> None:
    found = found_in(arm, arm)
    assert len(found.findings) == 1 and "noise floor" in found.findings[0]
    assert found.side is None and np.isnan(found.controller_share).all()
    assert np.nanmax(np.abs(found.lag_ms)) < 1


def test_a_delay_is_late_and_on_the_controller_side(arm) -> None:
    found = found_in(arm, hidden(arm, "command_delay", seconds=[0.03, 0.03]))
    assert found.side > 0.9 and np.all(found.controller_share > 0.9)
    assert found.lag_ms == pytest.approx([30, 30], abs=2)
    assert said(found, "30 ms later") and said(found, "fast motion") and said(found, "correlates with speed")
    assert said(found, "controller side")
    assert found.chi2[0, 3] > found.chi2[0, 1]  # fast against hold


def test_friction_is_on_the_plant_side(arm) -> None:
    found = found_in(arm, hidden(arm, "coulomb_friction", torque=[1.0, 0.3]))
    assert found.side < 0.1 and said(found, "plant side")


def test_a_delay_that_the_model_has_is_no_fault_of_the_controller(arm) -> None:
    late = hidden(arm, "command_delay", seconds=[0.03, 0.03])
    found = found_in(late, hidden(late, "coulomb_friction", torque=[1.0, 0.3]))
    assert found.side < 0.1 and said(found, "plant side")


def test_without_effort_no_side_is_named(arm) -> None:
    found = found_in(arm, hidden(arm, "command_delay", seconds=[0.03, 0.03]), effort=False)
    assert found.side is None and not said(found, "side,")


def test_effort_that_nothing_explains_is_not_believed(arm) -> None:
    log = record(hidden(arm, "command_delay", seconds=[0.03, 0.03]), noise=NOISE)
    noise = np.random.default_rng(0).standard_normal(log.position.shape)
    found = error_breakdown(arm, [log.with_(effort=np.cumsum(noise, axis=0))])
    assert found.side is None


def test_a_bias_is_a_constant_error(arm) -> None:
    found = found_in(arm, hidden(arm, "torque_bias", torque=[0.5, 0.2]))
    assert said(found, "constant", "mrad")
    assert np.nanmax(np.abs(found.lag_ms)) < 1


def test_one_faulty_joint_is_named_alone(arm) -> None:
    found = found_in(arm, hidden(arm, "servo_deadzone", width=[0.0, 0.02]))
    assert said(found, "Joint elbow is worst")
    assert found.comparison.joint_chi2[0, 1] > 20 * found.comparison.joint_chi2[0, 0]


def test_no_effect_is_ever_named(arm) -> None:
    found = found_in(arm, hidden(arm, "command_delay", seconds=[0.03, 0.03]))
    text = " ".join(found.findings)
    assert not any(name in text or name.replace("_", " ") in text for name in CATALOGUE)


def test_profiles_show_the_error_against_speed(arm) -> None:
    found = found_in(arm, hidden(arm, "command_delay", seconds=[0.03, 0.03]))
    profile = next(p for p in found.profiles if (p.joint, p.against) == ("shoulder", "speed"))
    assert profile.share > 0.9
    assert np.all(np.diff(profile.centre) > 0) and np.all(profile.low <= profile.median)
    slope = np.polyfit(profile.centre, profile.median, 1)[0]
    assert slope == pytest.approx(-0.03, rel=0.1)  # rad per rad/s: the delay in s


def test_json_and_table(arm) -> None:
    found = found_in(arm, hidden(arm, "command_delay", seconds=[0.03, 0.03]))
    data = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert data["lag"]["unit"] == "ms" and data["chi2"]["elbow"]["all"] > 100
    assert data["findings"] == list(found.findings)
    text = str(found)
    assert "late ms" in text and max(len(line) for line in text.splitlines()[:5]) <= 110
    assert repr(found).startswith("ErrorBreakdown('two', n=2")
