"""The plant in PyBullet does what the fits simulate, and PyBullet's traps are avoided."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.engines.bullet.plant import BulletPlant
from embodiedreamer_gym.engines.plant import replay
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from tests.bank import BUILT_IN, fast, plain, robot
from tests.two_joint_arm import write_arm

MANY = {
    "command": ("command_delay", "command_rate_limit", "coulomb_friction", "payload", "encoder_offset"),
    "friction": ("stribeck_friction", "load_friction", "direction_dependent_friction", "torque_bias"),
    "gears": ("joint_elasticity", "backlash", "hysteresis", "torque_fade", "torque_constant", "quadratic_drag"),
    "limits": ("command_lowpass", "servo_deadzone", "voltage_limit", "joint_spring", "base_tilt"),
}


def same(model: RobotModel, recording, tolerance: float = 1e-6) -> None:
    mine, theirs = simulate(model, recording), replay(BulletPlant(model), recording)
    np.testing.assert_allclose(theirs.position, mine.position, rtol=0, atol=tolerance)
    np.testing.assert_allclose(theirs.velocity, mine.velocity, rtol=0, atol=1e3 * tolerance)


@pytest.mark.parametrize("effects", MANY.values(), ids=list(MANY))
@pytest.mark.parametrize("name", BUILT_IN)
def test_a_free_run_equals_its_replay_in_pybullet(name: str, effects: tuple[str, ...]) -> None:
    model = robot(name)
    for effect in effects:
        model = model.with_effect(plain(model, model.catalogue[effect], 0.5))
    same(model, fast(model, 1.5))


@pytest.mark.parametrize("rule", ["linear", "hold"])
def test_a_replay_follows_the_commands_rule(rule: str) -> None:
    model = robot("arm6").with_(command_hold=rule)
    same(model, fast(model, 1.0, rate=30.0))


def test_friction_and_damping_written_in_a_urdf_do_not_count(tmp_path: Path) -> None:
    """PyBullet would damp the joint by the URDF's damping (explicitly) and ignores its friction; nor do we."""
    path = write_arm(tmp_path)
    recording = fast(RobotModel.load(path), 1.0)
    clean = replay(BulletPlant(RobotModel.load(path)), recording)
    urdf = (tmp_path / "two.urdf").read_text()
    (tmp_path / "two.urdf").write_text(
        urdf.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics damping="3.0" friction="2.0"/>')
    )
    rough = RobotModel.load(path)
    np.testing.assert_array_equal(replay(BulletPlant(rough), recording).position, clean.position)
    same(rough, recording)


def test_pybullets_own_motors_and_dampings_are_off() -> None:
    """Without servo, friction and damping a pendulum keeps its energy for ten seconds."""
    model = robot("pendulum1").with_(
        stiffness=np.zeros(1), damping=np.zeros(1), viscous_friction=np.zeros(1), rotor_inertia=np.zeros(1)
    )
    highest = []
    with BulletPlant(model) as plant:
        plant.reset(np.array([1.0]), np.zeros(1), np.zeros(1))
        for _ in range(2400):
            plant.step(np.zeros(1))
            highest.append(plant.measured[0])
    swing = np.abs(highest)
    assert swing[-400:].max() == pytest.approx(1.0, abs=0.01)
    assert swing[:400].max() == pytest.approx(1.0, abs=0.01)


def test_two_arms_of_one_model_do_not_feel_each_other() -> None:
    model = robot("aloha")
    recording = fast(model, 1.0)
    right = np.array([name.startswith("right") for name in model.joints])
    command = recording.command.copy()
    command[:, right] = command[0, right]
    one_still = recording.with_(command=command)
    for run in (simulate, lambda model, log: replay(BulletPlant(model), log)):
        both, single = run(model, recording), run(model, one_still)
        np.testing.assert_allclose(single.position[:, ~right], both.position[:, ~right], rtol=0, atol=1e-9)
        assert np.abs(single.position[:, right] - both.position[:, right]).max() > 0.02


def test_a_plant_shares_a_world_and_leaves_it_open() -> None:
    client = BulletClient(pybullet.DIRECT)
    try:
        with BulletPlant(robot("servo"), client) as plant:
            plant.reset(np.array([0.1]), np.zeros(1), np.array([0.1]))
            plant.step(np.array([0.1]))
            assert plant.measured[0] == pytest.approx(0.1)
        assert client.isConnected() and client.getNumBodies() == 1
    finally:
        client.disconnect()
    own = BulletPlant(robot("servo"))
    own.close()
    own.close()


def test_another_robots_log_is_refused() -> None:
    with pytest.raises(SimulationError, match="joints"):
        replay(BulletPlant(robot("servo")), fast(robot("arm6")))
