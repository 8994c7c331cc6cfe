"""Recordings at several firmware gains: the stiffness of each run, limits of the drive, other engines."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects.torque_saturation import TorqueSaturation
from embodiedreamer_gym.errors import CalibrationError
from embodiedreamer_gym.phys_aligner import calibrate
from embodiedreamer_gym.simulation import simulate, simulate_sets
from tests.bank import fast, robot


def test_a_gain_multiplies_the_stiffness_of_its_own_run() -> None:
    """Runs of several gains in one batch, of two parameter sets each, equal runs of stiffer models."""
    model = robot("arm6")
    logs = [fast(model, seconds, seed=k).with_(gain=gain) for k, (seconds, gain) in enumerate([(0.6, 1.0), (1.6, 4.0),
            (1.1, np.linspace(0.3, 2.0, model.n))])]  # fmt: skip
    sets = {"stiffness": np.stack([model.stiffness, 0.5 * model.stiffness])}
    for run, log in zip(simulate_sets(model, logs, sets), logs, strict=True):
        for k, values in enumerate(sets["stiffness"]):
            alone = simulate(model.with_(stiffness=values * log.gain), log.with_(gain=1.0))
            np.testing.assert_allclose(run.position[k], alone.position, rtol=0, atol=1e-9)
            np.testing.assert_allclose(run.torque[k], alone.torque, rtol=0, atol=1e-6)


def test_the_drives_limit_comes_after_the_gain() -> None:
    """A drive at its limit gives the same torque at any gain."""
    model = robot("pendulum1").with_effect(TorqueSaturation(limit={"joint1": 1.0}))
    log = fast(model, 1.0)
    strong = simulate(model, log.with_(gain=100.0))
    assert np.abs(strong.torque).max() == pytest.approx(1.0, abs=1e-6)
    assert np.mean(np.abs(strong.torque) > 0.999) > 0.5


def test_one_fit_of_two_gains_finds_the_stiffness() -> None:
    model = robot("pendulum1")
    true = model.with_(stiffness=1.3 * model.stiffness)
    logs = [fast(model, 1.5, seed=k).with_(gain=gain, noise=np.full(1, 1e-4)) for k, gain in enumerate((1.0, 4.0))]
    logs = [log.with_(position=simulate(true, log).position) for log in logs]
    assert calibrate(model, logs).model.stiffness == pytest.approx(true.stiffness, rel=1e-3)
    with pytest.raises(CalibrationError, match="with the same gain"):
        calibrate(model, logs, "surrogate")
