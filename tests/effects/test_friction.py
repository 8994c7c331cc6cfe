"""Friction: its torque by speed, load and direction, and what it does to a pendulum."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.effects import JointState
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.direction_dependent_friction import DirectionDependentFriction
from embodiedreamer_gym.effects.hysteresis import Hysteresis
from embodiedreamer_gym.effects.load_friction import LoadFriction
from embodiedreamer_gym.effects.quadratic_drag import QuadraticDrag
from embodiedreamer_gym.effects.stribeck_friction import StribeckFriction
from embodiedreamer_gym.effects.torque_bias import TorqueBias
from embodiedreamer_gym.simulation import simulate
from tests.bank import log, robot


def state(speed=0.0, torque=0.0, external=0.0) -> JointState:
    speed, torque, external = np.broadcast_arrays(*(np.atleast_2d(x) for x in (speed, torque, external)))
    return JointState(np.zeros(speed.shape), speed, torque, 1 / 240, 0.0, external)


def test_the_stribeck_curve() -> None:
    p = SimpleNamespace(sliding=0.2, extra_static=0.3, speed=0.1)
    forward, backward = StribeckFriction.friction(state([0.0, 0.1, -0.1, 10.0]), p)
    np.testing.assert_allclose(forward[0], [0.5, 0.2 + 0.3 / np.e, 0.2 + 0.3 / np.e, 0.2])
    np.testing.assert_allclose(backward, forward)


def test_friction_that_grows_with_the_load() -> None:
    joint = state(0.0, [2.0, -3.0, 2.0, 2.0], [0.0, 0.0, -2.0, 3.0])  # drive alone, holding a load, driven by it
    p = SimpleNamespace(coefficient=0.2, external=0.1, static=0.0, speed=0.1)
    forward, backward = LoadFriction.friction(joint, p)
    np.testing.assert_allclose(forward[0], [0.4, 0.6, 0.6, 0.1])
    np.testing.assert_allclose(backward, forward)
    p.static = 0.3
    for speed, share in ((0.0, 1.0), (-0.1, np.exp(-1.0)), (10.0, 0.0)):
        joint.velocity = np.full((1, 4), speed)
        more = LoadFriction.friction(joint, p)[1] - backward
        np.testing.assert_allclose(more[0], 0.3 * share * np.array([2.0, 3.0, 4.0, 1.0]), atol=1e-12)


def test_friction_has_one_level_for_each_direction() -> None:
    p = SimpleNamespace(forward=0.3, backward=0.1, torque=0.2)
    assert DirectionDependentFriction.friction(state(), p) == (0.3, 0.1)
    assert CoulombFriction.friction(state(), p) == (0.2, 0.2)


def test_drag_grows_with_the_square_of_the_speed() -> None:
    forward, backward = QuadraticDrag.friction(state([0.0, 0.5, -2.0]), SimpleNamespace(coefficient=0.3))
    np.testing.assert_allclose(forward[0], [0.0, 0.075, 1.2])
    np.testing.assert_allclose(backward, forward)


def presliding(path, torque: float = 0.5, travel: float = 0.01, start: float = 0.0) -> np.ndarray:
    """Torque of hysteresis along a path (k,) rad."""
    p = SimpleNamespace(torque=np.full((1, 1), torque), travel=np.full((1, 1), travel))
    memory, out = Hysteresis.start(np.full((1, 1), start), p, 1 / 240), []
    for q in path:
        joint = JointState(np.full((1, 1), q), np.zeros((1, 1)), np.zeros((1, 1)), 1 / 240, 0.0)
        taken, memory = Hysteresis.law(np.zeros((1, 1)), joint, memory, p)
        out.append(-taken[0, 0])
    return np.array(out)


def test_hysteresis_builds_up_over_its_travel_and_changes_sides_after_a_reversal() -> None:
    path = np.r_[np.linspace(0, 0.2, 50), np.linspace(0.2, 0.15, 500)]
    torque = presliding(path)
    np.testing.assert_allclose(torque[:50], 0.5 * (1 - np.exp(-path[:50] / 0.01)), atol=1e-12)
    back = 0.2 - path[50:]
    np.testing.assert_allclose(torque[50:], 0.5 * (2 * np.exp(-back / 0.01) - 1), atol=1e-8)
    np.testing.assert_allclose(presliding(path[::5])[10:], torque[50::5], atol=1e-8)  # whatever the step


def test_a_loop_of_hysteresis_takes_energy() -> None:
    for reach in (0.001, 0.01, 0.1):
        path = reach * np.sin(np.linspace(0, 20 * np.pi, 4001))
        torque = presliding(path)
        loops = np.add.reduceat((torque[1:] + torque[:-1]) / 2 * np.diff(path), np.arange(0, 4000, 400))
        assert np.all(loops[1:] > 0) and loops[-1] < 4 * 0.5 * reach


def test_hysteresis_takes_up_what_is_left_over_at_rest() -> None:
    """A servo that is a little off its balance does not move the joint; beyond the friction's level it does."""
    model = robot("pendulum1").with_effect(Hysteresis(torque={"joint1": 0.4}))
    time = np.arange(101) / 100
    for surplus, stays in ((0.38, True), (-0.38, True), (0.6, False)):
        command = np.full((101, 1), surplus / model.stiffness[0])
        run = simulate(model, log(model, time, command, np.zeros((101, 1))))
        assert bool(np.abs(run.position).max() < 1e-9) is stays


@pytest.mark.parametrize(
    ("effect", "ahead", "back"),
    [
        (CoulombFriction(torque={"joint1": 0.4}), 0.4, 0.4),
        (Hysteresis(torque={"joint1": 0.4}, travel={"joint1": 0.01}), 0.4, 0.4),
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


@pytest.mark.parametrize(("share", "external"), [(0.25, 0.0), (0.0, 0.25), (0.2, 0.1)])
def test_load_friction_takes_its_share_of_the_torque_that_lifts(share: float, external: float) -> None:
    """Slowly up: servo - share * servo - external * weight carries the weight; slowly down the shares add to it."""
    gears = LoadFriction(coefficient={"joint1": share}, external={"joint1": external})
    model = robot("pendulum1").with_(viscous_friction=np.zeros(1)).with_effect(gears)
    time = np.arange(301) / 100
    for sign in (1, -1):
        run = simulate(model, log(model, time, (0.65 + sign * 0.1 * (time - 1.5))[:, None]))
        weight = 9.81 * 0.15 * np.sin(run.position[150:, 0])
        ratio = (1 + sign * external) / (1 - sign * share)
        np.testing.assert_allclose(run.torque[150:, 0], ratio * weight, rtol=5e-3)


def test_a_spring_beside_the_weight_loads_the_gears() -> None:
    """The load laws' torque is external too: a spring that carries the weight leaves the gears nothing to rub on."""
    model = robot("pendulum1").with_(viscous_friction=np.zeros(1))
    bias = TorqueBias(torque={"joint1": 9.81 * 0.15 * np.sin(0.5)})
    model = model.with_effect(LoadFriction(external={"joint1": 0.3})).with_effect(bias)
    time = np.arange(201) / 100
    run = simulate(model, log(model, time, (0.5 + 0.01 * (time - 1.0))[:, None]))
    assert np.abs(run.torque[100:, 0]).max() < 0.03 * 9.81 * 0.15
