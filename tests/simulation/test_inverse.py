"""Inverse runs: from a measured motion back to the effort that made it."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import inverse_sets, run_sets
from tests.bank import plain
from tests.two_joint_arm import load_arm, record

PLANT_SIDE = (
    "coulomb_friction", "stribeck_friction", "load_friction", "direction_dependent_friction",
    "quadratic_drag", "torque_bias", "torque_ripple", "joint_spring", "rotor_inertia", "payload", "base_tilt",
    "encoder_offset", "torque_constant",
)  # fmt: skip
BEFORE_THE_DRIVE = ("command_delay", "command_lowpass", "servo_deadzone")


@pytest.fixture
def arm(tmp_path) -> RobotModel:
    """The faultless arm."""
    return load_arm(tmp_path)


def log_of(model: RobotModel) -> Recording:
    """A log of the model's motion and of its effort in N m, without the commands."""
    log = record(model)
    return log.with_(command=None, effort=np.asarray(log.effort) / 2.0, effort_unit="N m")


def misfit(model: RobotModel, log: Recording) -> np.ndarray:
    """Rms (n,) of measured less simulated effort over its spread."""
    signals = Signals(model, [log])
    error, usable = signals.errors(run_sets(model, signals.recordings))[0][0], signals.usable[0]
    assert usable.mean() > 0.4
    size = np.std(np.asarray(log.effort), axis=0)
    return np.array([np.sqrt(np.mean(error[usable[:, j], j] ** 2)) / size[j] for j in range(model.n)])


def test_both_efforts_pass_the_same_filter(arm: RobotModel) -> None:
    """Derivatives that pass less of the motion than the effort's filter does leave four times as much."""
    assert misfit(arm, log_of(arm)).max() < 0.005


@pytest.mark.parametrize("name", PLANT_SIDE)
def test_the_effort_of_a_known_motion_is_found(name: str, arm: RobotModel) -> None:
    """With the effect the effort comes back within a few per cent; without it, it does not.

    What gears rub more near standstill passes in a shorter time than the filter's.
    """
    truth = arm.with_effect(plain(arm, CATALOGUE[name]))
    log = log_of(truth)
    with_effect, without = misfit(truth, log), misfit(arm, log)
    assert with_effect.max() < (0.25 if name == "load_friction" else 0.1)
    assert without.max() > 3 * with_effect.max()


@pytest.mark.parametrize("name", BEFORE_THE_DRIVE)
def test_what_lies_before_the_drive_plays_no_part(name: str, arm: RobotModel) -> None:
    """A measured motion tells nothing of the command that asked for it."""
    truth = arm.with_effect(plain(arm, CATALOGUE[name]))
    log = log_of(truth)
    np.testing.assert_allclose(misfit(truth, log), misfit(arm, log))


def test_parameter_sets_are_independent(arm: RobotModel) -> None:
    """A batch gives what its sets give alone, also where masses differ."""
    model = arm.with_effect("payload").with_effect("coulomb_friction")
    log = log_of(model)
    sets = {"payload.mass": np.array([[0.0], [0.2], [0.4]]), "coulomb_friction.torque": np.full((3, 2), 0.3)}
    together = inverse_sets(model, log, sets).torque
    for k in range(3):
        alone = inverse_sets(model, log, {name: values[k : k + 1] for name, values in sets.items()}).torque
        np.testing.assert_allclose(together[k], alone[0], atol=1e-12)
    assert np.abs(together[2] - together[0]).max() > 0.1


def test_a_log_needs_a_command_or_an_effort_and_all_the_same(arm: RobotModel) -> None:
    """One sentence each."""
    log = record(arm)
    with pytest.raises(SimulationError, match="neither a command nor an effort"):
        run_sets(arm, [log.with_(command=None, effort=None)])
    with pytest.raises(SimulationError, match="others have one"):
        run_sets(arm, [log, log.with_(command=None)])
