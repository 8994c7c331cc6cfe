"""Friction: its torque by speed, load and direction, and what it does to a pendulum."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.effects import JointState
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.direction_dependent_friction import DirectionDependentFriction
from embodiedreamer_gym.effects.load_friction import LoadFriction
from embodiedreamer_gym.effects.stribeck_friction import StribeckFriction
from embodiedreamer_gym.simulation import simulate
from tests.bank import log, robot


def state(speed=0.0, torque=0.0) -> JointState:
    speed, torque = np.broadcast_arrays(np.atleast_2d(speed), np.atleast_2d(torque))
    return JointState(np.zeros(speed.shape), speed, torque, 1 / 240, 0.0)


def test_the_stribeck_curve() -> None:
    p = SimpleNamespace(sliding=0.2, extra_static=0.3, speed=0.1)
    forward, backward = StribeckFriction.friction(state([0.0, 0.1, -0.1, 10.0]), p)
    np.testing.assert_allclose(forward[0], [0.5, 0.2 + 0.3 / np.e, 0.2 + 0.3 / np.e, 0.2])
    np.testing.assert_allclose(backward, forward)


def test_friction_that_grows_with_the_load() -> None:
    forward, backward = LoadFriction.friction(state(0.0, [2.0, -3.0]), SimpleNamespace(coefficient=0.2))
    np.testing.assert_allclose(forward[0], [0.4, 0.6])
    np.testing.assert_allclose(backward, forward)


def test_friction_has_one_level_for_each_direction() -> None:
    p = SimpleNamespace(forward=0.3, backward=0.1, torque=0.2)
    assert DirectionDependentFriction.friction(state(), p) == (0.3, 0.1)
    assert CoulombFriction.friction(state(), p) == (0.2, 0.2)


@pytest.mark.parametrize(
    ("effect", "ahead", "back"),
    [
        (CoulombFriction(torque={"joint1": 0.4}), 0.4, 0.4),
        (DirectionDependentFriction(forward={"joint1": 0.5}, backward={"joint1": 0.1}), 0.5, 0.1),
        (
            StribeckFriction(sliding={"joint1": 0.3}, extra_static={"joint1": 0.3}, speed={"joint1": 0.02}),
            0.3,
            0.3,
        ),
    ],
)
def test_a_slow_sweep_carries_the_friction_torque(effect, ahead: float, back: float) -> None:
    """At constant speed through the lowest point the servo gives friction and viscous torque, nothing else."""
    model = robot("pendulum1")
    time = np.arange(401) / 100
    for sign, level in ((1, ahead), (-1, back)):
        command = (sign * 0.2 * (time - 2.0))[:, None]
        run = simulate(model.with_effect(effect), log(model, time, command))
        weight = 9.81 * 0.15 * np.sin(run.position[200:, 0])
        rest = run.torque[200:, 0] - weight - model.viscous_friction[0] * run.velocity[200:, 0]
        np.testing.assert_allclose(rest, sign * level, atol=2e-3)


def test_load_friction_takes_its_share_of_the_torque_that_lifts() -> None:
    """Slowly up: servo - friction carries the weight, so the servo gives weight / (1 - share)."""
    model = robot("pendulum1").with_(viscous_friction=np.zeros(1))
    time = np.arange(301) / 100
    lift = log(model, time, (0.5 + 0.1 * time)[:, None])
    run = simulate(model.with_effect(LoadFriction(coefficient={"joint1": 0.25})), lift)
    weight = 9.81 * 0.15 * np.sin(run.position[150:, 0])
    np.testing.assert_allclose(run.torque[150:, 0], weight / 0.75, rtol=5e-3)
