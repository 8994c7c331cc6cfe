"""How much of an error a general regression predicts."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from embodiedreamer_gym.diagnosis.error_ceiling import SIGNALS, explainable_shares
from tests.bank import case


def test_a_delay_is_predictable_from_the_command_and_noise_from_nothing() -> None:
    robot, model = case("command_delay", "pendulum1", 0)
    logs = [*robot.train, *robot.test]
    shares = explainable_shares(model, logs)
    assert shares.shape == (model.n, len(SIGNALS)) and shares[0, SIGNALS.index("command")] > 0.8
    rng = np.random.default_rng(0)
    noise = [r.with_(position=r.position + 0.5 * rng.standard_normal(r.position.shape)) for r in logs]
    assert explainable_shares(model, noise).max() < 0.1
