"""What one step must survive: sticking, stops, stiff gains, steep motors, effects on the drive's torque."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import SignalLaw
from embodiedreamer_gym.effects.coulomb_friction import CoulombFriction
from embodiedreamer_gym.effects.effect import Parameter
from embodiedreamer_gym.effects.stribeck_friction import StribeckFriction
from embodiedreamer_gym.effects.torque_saturation import TorqueSaturation
from embodiedreamer_gym.effects.voltage_limit import VoltageLimit
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.simulation import TIME_STEP, Drive, simulate, simulate_sets
from tests.bank import BUILT_IN, centre, fast, log, robot, still


def every(model, value) -> dict[str, float]:
    return dict(zip(model.joints, np.broadcast_to(value, model.n).tolist(), strict=True))


@pytest.mark.parametrize("kind", ["coulomb", "stribeck"])
@pytest.mark.parametrize("name", ["arm6", "so101"])
def test_a_stuck_arm_does_not_creep(name: str, kind: str) -> None:
    """Ten seconds at rest, the servo 80 % of the friction away from where it would be at rest."""
    model = robot(name)
    friction = 0.5 * model.torque_scale
    effect = CoulombFriction(torque=every(model, friction))
    if kind == "stribeck":
        half = every(model, friction / 2)
        effect = StribeckFriction(sliding=half, extra_static=half, speed=every(model, 0.05))
    rest = still(model, seconds=10.0)
    signs = np.where(np.arange(model.n) % 2, 1.0, -1.0)
    pushed = rest.with_(command=rest.command + 0.8 * signs * friction / model.stiffness)
    run = simulate(model.with_effect(effect), pushed)
    np.testing.assert_allclose(run.position, rest.position, rtol=0, atol=1e-9)
    assert np.abs(simulate(model, pushed).position - rest.position).max() > 0.01


def test_a_stuck_arm_breaks_loose_above_its_friction() -> None:
    model = robot("arm6")
    rest = still(model)
    stuck = model.with_effect(CoulombFriction(torque=every(model, 0.5)))
    away = rest.with_(command=rest.command + 0.6 / model.stiffness)
    assert np.all(np.abs(simulate(stuck, away).position[-1] - rest.position[-1]) > 1e-4)


@pytest.mark.parametrize("factor", [10.0, 100.0])
@pytest.mark.parametrize("name", [*BUILT_IN, "arm6", "arm7"])
def test_gains_beyond_what_the_step_resolves_do_not_explode(name: str, factor: float) -> None:
    """Stiffness `factor` times beyond the step's limit, with and without damping to match."""
    model = robot(name)
    matrix, _ = model.bodies.mass_matrix_and_bias(centre(model)[None], np.zeros((1, model.n)), model.nominal_mechanics)
    heavy = np.diagonal(matrix[0]) + model.rotor_inertia
    stiff = factor * 4 * heavy / TIME_STEP**2
    for damping in (model.damping, factor * heavy / TIME_STEP, 0.1 * model.damping):
        hard = model.with_(stiffness=stiff, damping=damping)
        recording = fast(hard, 1.0)
        run = simulate(hard, recording)
        late = recording.time > 0.3
        assert np.abs(run.position - recording.command)[late].max() < 0.2, "it should follow all the better"
        assert np.abs(run.velocity).max() < 50


def test_a_steep_motor_neither_rings_nor_explodes() -> None:
    """A torque-speed line whose time constant is a hundredth of a step."""
    model = robot("arm6")
    low, high = 0.2, model.torque_scale * 1e3
    limit = VoltageLimit(forward=every(model, low), backward=every(model, low), stall_torque=every(model, high))
    run = simulate(model.with_effect(limit), fast(model, 2.0, rate=240.0))
    speed = np.abs(run.velocity[24:])
    assert speed.max() < 2.0 * low, "the mean of two steps is limited, one of them may be beyond"
    assert np.mean(speed > 1.05 * low) < 0.02


def test_a_limit_of_the_range_is_a_stop() -> None:
    model = robot("arm6")
    top = model.tree.upper
    time = np.arange(481) / 240  # the plant's own instants
    command = centre(model) + np.clip(time - 0.1, 0, 1)[:, None] * 2 * (top - centre(model))
    run = simulate(model, log(model, time, command))
    assert np.all(run.position <= top + 1e-9)
    np.testing.assert_allclose(run.position[-1, [0, 3, 5]], top[[0, 3, 5]], atol=1e-3)


def test_a_start_beyond_the_range_comes_back_gently() -> None:
    model = robot("arm6")
    top, time = model.tree.upper, np.arange(101) / 100
    run = simulate(model, log(model, time, np.tile(top, (101, 1)), np.tile(top + 0.01, (101, 1))))
    assert np.abs(run.velocity).max() < 5
    assert np.all(np.abs(run.position[-1] - top) < 0.05)


class HalfTorque(SignalLaw):
    """A drive that gives a share less than its servo asks for."""

    name = "half_torque"
    stage = "drive"
    parameters = (Parameter("share", "1", off=0.0, low=0.0, high=0.9, typical=0.5),)
    symptom = "too little torque"
    reveals = "everything"

    @staticmethod
    def law(signal, joint, memory, p):
        return signal * (1 - p.share), memory


@pytest.mark.parametrize("limited", [False, True])
def test_a_law_on_the_drives_torque_is_a_change_of_gains(limited: bool) -> None:
    """The torque that the drive reports is the one before the law, on which its limits act."""
    model = robot("arm6")
    less = model.with_effect(HalfTorque(share=every(model, 0.5)))
    weaker = model.with_(stiffness=0.5 * model.stiffness, damping=0.5 * model.damping)
    if limited:
        highest = 0.6 * model.torque_scale
        less = less.with_effect(TorqueSaturation(limit=every(model, highest)))
        weaker = weaker.with_effect(TorqueSaturation(limit=every(model, 0.5 * highest)))
    recording = fast(model, 1.5)
    a, b = simulate(less, recording), simulate(weaker, recording)
    np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(0.5 * a.torque, b.torque, rtol=0, atol=1e-7)
    assert np.abs(simulate(model, recording).position - a.position).max() > 0.01


class WeakDrive(HalfTorque):
    """A drive whose torque bends over and never passes a level."""

    name = "weak_drive"
    parameters = (Parameter("level", "N m", off=1e6, low=0.1, high=1e6, typical=1.0),)

    @staticmethod
    def law(signal, joint, memory, p):
        return p.level * np.tanh(signal / p.level), memory


def test_a_law_that_bends_the_torque_converges_with_the_step() -> None:
    model = robot("arm6")
    weak = model.with_effect(WeakDrive(level=every(model, 0.7 * model.torque_scale)))
    recording = fast(model, 1.5, rate=240.0)
    coarse, fine = (simulate(weak, recording, dt=dt) for dt in (TIME_STEP, TIME_STEP / 8))
    assert np.abs(simulate(model, recording).position - fine.position).max() > 0.02
    assert np.sqrt(np.mean((coarse.position - fine.position) ** 2)) < 6e-4


def test_a_diverging_set_is_clipped_and_a_diverging_model_is_said_so() -> None:
    model = robot("arm6").with_(viscous_friction=np.zeros(6), damping=np.zeros(6))
    recording = fast(model, 1.0)
    wild = {"rotor_inertia": np.stack([model.rotor_inertia, model.rotor_inertia])}
    wild["stiffness"] = np.stack([model.stiffness, model.stiffness * 1e9])
    batch = simulate_sets(model, [recording], wild)[0]
    assert np.all(np.isfinite(batch.position)) and np.all(np.isfinite(batch.torque))
    np.testing.assert_allclose(batch.position[0], simulate(model, recording).position, atol=1e-9)


def test_a_law_that_blows_up_is_a_plain_error() -> None:
    class Runaway(HalfTorque):
        name = "runaway"

        @staticmethod
        def law(signal, joint, memory, p):
            return signal + 1e7 * joint.velocity + 1e7, memory

    model = robot("arm6").with_effect(Runaway())
    free = model.with_(tree=model.tree)
    with pytest.raises(SimulationError, match="diverges; check its servo gains"):
        simulate(free, fast(model, 1.0))


def test_a_batch_is_sets_times_rollouts() -> None:
    model = robot("arm6")
    drive = Drive(model, {"stiffness": np.tile(model.stiffness, (3, 1))}, rollouts=2)
    assert (drive.sets, drive.rollouts, drive.batch) == (3, 2, 6)
    start = np.tile(centre(model), (6, 1))
    drive.start(start, 0 * start, start)
    drive.advance(drive.accelerate(start))
    drive.keep(1)
    assert drive.position.shape == (3, 6) and drive.accelerate(start[:3]).shape == (3, 6)
