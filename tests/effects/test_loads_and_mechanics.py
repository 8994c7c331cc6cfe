"""Bias, ripple, spring, payload, rotor, tilt, encoder offset and errors of the masses: torques known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.base_tilt import BaseTilt
from embodiedreamer_gym.effects.encoder_offset import EncoderOffset
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.effects.joint_spring import JointSpring
from embodiedreamer_gym.effects.payload import Payload
from embodiedreamer_gym.effects.rotor_inertia import RotorInertia
from embodiedreamer_gym.effects.torque_bias import TorqueBias
from embodiedreamer_gym.effects.torque_ripple import TorqueRipple
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.data import UrdfError
from embodiedreamer_gym.simulation import Drive, simulate
from tests.bank import fast, log, robot

WEIGHT = 9.81 * 0.15  # N m/rad, 1 kg whose centre hangs 0.15 m below the axis
TIP = 0.3  # m


def hold(effect: Effect, command: float = 0.8) -> tuple[float, float]:
    """Measured angle and servo torque of a pendulum that has come to rest under a constant command."""
    model = robot("pendulum1")
    time = np.arange(301) / 100
    run = simulate(model.with_effect(effect), log(model, time, np.full((301, 1), command)))
    assert abs(run.velocity[-1, 0]) < 1e-5
    assert run.torque[-1, 0] == pytest.approx(model.stiffness[0] * (command - run.position[-1, 0]), abs=1e-6)
    return float(run.position[-1, 0]), float(run.torque[-1, 0])


def test_without_an_effect_the_servo_carries_the_weight() -> None:
    q, torque = hold(TorqueBias())
    assert torque == pytest.approx(WEIGHT * np.sin(q), abs=1e-5)


def test_a_bias_pushes_the_joint_forward() -> None:
    q, torque = hold(TorqueBias(torque={"joint1": 0.5}))
    assert torque == pytest.approx(WEIGHT * np.sin(q) - 0.5, abs=1e-5)


def test_a_spring_pulls_towards_its_angle() -> None:
    q, torque = hold(JointSpring(stiffness={"joint1": 2.0}, angle={"joint1": 0.3}))
    assert torque == pytest.approx(WEIGHT * np.sin(q) + 2.0 * (q - 0.3), abs=1e-5)


def test_ripple_pushes_by_the_sine_of_the_angle() -> None:
    ripple = {"amplitude": {"joint1": 0.4}, "frequency": {"joint1": 12.0}, "phase": {"joint1": 0.5}}
    q, torque = hold(TorqueRipple(**ripple))
    assert torque == pytest.approx(WEIGHT * np.sin(q) - 0.4 * np.sin(12.0 * q + 0.5), abs=1e-5)


def test_a_heavier_rotor_weighs_nothing_and_is_as_slow_as_the_models_own() -> None:
    model = robot("pendulum1")
    q, torque = hold(RotorInertia(inertia={"joint1": 0.03}))
    assert torque == pytest.approx(WEIGHT * np.sin(q), abs=1e-5)
    extra = model.with_effect(RotorInertia(inertia={"joint1": 0.03}))
    own = model.with_(rotor_inertia=model.rotor_inertia + 0.03)
    motion = fast(model, 1.0)
    np.testing.assert_array_equal(simulate(extra, motion).position, simulate(own, motion).position)


def test_a_payload_adds_its_weight_at_the_tip() -> None:
    q, torque = hold(Payload(mass={"tip": 0.7}))
    assert torque == pytest.approx((WEIGHT + 9.81 * 0.7 * TIP) * np.sin(q), abs=1e-4)


def test_a_payload_adds_its_inertia_at_the_tip() -> None:
    model = robot("pendulum1")
    matrices = []
    for m in (model, model.with_effect(Payload(mass={"tip": 0.7}))):
        mechanics = Drive(m).mechanics
        matrices.append(model.bodies.mass_matrix_and_bias(np.ones((1, 1)), np.zeros((1, 1)), mechanics)[0])
    assert matrices[1][0, 0, 0] - matrices[0][0, 0, 0] == pytest.approx(0.7 * TIP**2)


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.1), (0.0, -0.2), (0.15, 0.1)])
def test_a_tilted_base_leans_gravity(roll: float, pitch: float) -> None:
    """The joint turns about y: a pitch of the base adds to its angle, a roll takes weight off."""
    q, torque = hold(BaseTilt(roll={"tip": roll}, pitch={"tip": pitch}))
    lean = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    side = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    arm = 0.15 * np.array([-np.sin(q), 0, -np.cos(q)])
    weight = (lean @ side).T @ np.array([0, 0, -9.81])
    assert torque == pytest.approx(-np.cross(arm, weight)[1], abs=1e-5)


def test_an_encoder_offset_shows_as_weight_at_another_angle() -> None:
    q, torque = hold(EncoderOffset(angle={"joint1": 0.2}))
    assert torque == pytest.approx(WEIGHT * np.sin(q - 0.2), abs=1e-5)


def test_an_encoder_offset_starts_where_the_sensor_said() -> None:
    model = robot("pendulum1").with_effect(EncoderOffset(angle={"joint1": 0.2}))
    drive = Drive(model)
    drive.start(np.array([[0.5]]), np.zeros((1, 1)), np.array([[0.5]]))
    assert drive.position[0, 0] == pytest.approx(0.3)


def test_errors_of_mass_and_centre() -> None:
    q, torque = hold(InertialError(mass={"joint1": np.log(1.1)}, z={"joint1": -0.02}))
    assert torque == pytest.approx(9.81 * 1.1 * 0.17 * np.sin(q), abs=1e-4)


def test_errors_of_inertia_leave_a_body_that_can_exist() -> None:
    """Any stretch keeps second moments positive definite, the centre of mass and the mass; a stretch of 2 % is 4 %."""
    model = robot("pendulum1").with_(urdf_error=UrdfError(mass=0.5, centre=0.05, inertia=1.0))
    rng = np.random.default_rng(0)
    nominal = model.nominal_mechanics
    for _ in range(20):
        values = {
            f"stretch_{axis}": {"joint1": float(x)} for axis, x in zip("xyz", rng.uniform(-1.4, 1.4, 3), strict=True)
        }
        mechanics = Drive(model.with_effect(InertialError(**values))).mechanics
        assert mechanics.mass == pytest.approx(nominal.mass)
        assert mechanics.first_moment == pytest.approx(nominal.first_moment)
        mass, moment, inertia = mechanics.mass[0, 0], mechanics.first_moment[0, 0], mechanics.inertia[0, 0]
        centre = moment / mass
        central = inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        small, middle, large = np.linalg.eigvalsh(central)
        assert small > 0 and large <= small + middle + 1e-12


def test_the_errors_of_a_urdf_are_bounded_by_the_trust_in_it() -> None:
    """Three standard deviations of the model's own; an error of the urdf that is none is refused."""
    model = robot("pendulum1").with_(urdf_error=UrdfError(mass=0.05)).with_effect(InertialError)
    assert model.parameters()["inertial_error.mass[joint1]"].high == pytest.approx(0.15)
    with pytest.raises(ModelError, match="mass must be a number above 0"):
        UrdfError(mass=0.0)
