"""The spine: what is calibrated and diagnosed on logs is what a policy is trained in."""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import embodiedreamer_gym as er
from benchmarks.replay import TOLERANCE, run
from embodiedreamer_gym.envs.replay import replay
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.standin.cases import aloha_case
from tests.bank import robot

ID = "EmbodieDreamer/PutCupOnMat-v0"


@pytest.mark.release
def test_logs_to_diagnosis_to_environment() -> None:
    """HDF5 logs of a stand-in pair with a hidden effect, diagnosed, give an environment that errs as `compare` says."""
    found = run("coulomb_friction", "aloha", seed=7)
    assert found.effects == ("coulomb_friction",) and found.joints
    assert all(joint.startswith("left") for joint in found.joints)
    assert found.gap < TOLERANCE
    assert found.gap_without > 3 * TOLERANCE, "the effect in the file makes no difference"


@pytest.mark.parametrize("rule", ["linear", "hold"])
@pytest.mark.parametrize("hz", [30, 50])
def test_the_environment_follows_the_commands_rule_at_every_rate(rule: str, hz: int, tmp_path: Path) -> None:
    model = robot("aloha").with_(command_hold=rule).with_effect("command_delay").with_effect("encoder_offset")
    model = model.with_values({"command_delay.seconds": {"left_joint2": 0.03, "right_joint1": 0.011}})
    model.save(tmp_path / "B.json")
    case = aloha_case(None, "left", np.random.default_rng(1), episodes=2, seconds=3.0)
    time = np.arange(3 * hz) / hz
    at = [np.interp(time, case.train[0].time, column) for column in case.train[0].command.T]
    blank = er.Recording("log", model.joints, time, np.stack(at, 1), np.stack(at, 1), units=model.units,
                         noise=np.full(14, 1e-4), quantum=np.zeros(14), command_hold=rule)  # fmt: skip
    env = gym.make(ID, robot=str(tmp_path / "B.json"), obs_type="state", control_hz=hz, collisions=False)
    free = er.simulate(model, blank).position
    np.testing.assert_allclose(replay(env, blank), free, rtol=0, atol=1e-7 if hz == 30 else 5e-4)
    env.close()


def test_the_table_stops_an_arm_that_passes_through_it_without_collisions() -> None:
    seen = []
    for collisions in (True, False):
        env = gym.make(ID, obs_type="state", collisions=collisions)
        env.reset(seed=0)
        down = env.unwrapped.joint_positions()
        down[1], down[8] = 2.6, 2.6
        for _ in range(60):
            env.step(down)
        seen.append(env.unwrapped.engine.tip(0).position[2])
        env.close()
    assert seen[1] < 0.7 < seen[0]


def test_another_rate_or_robot_is_refused() -> None:
    env = gym.make(ID, obs_type="state", control_hz=20)
    log = aloha_case(None, "left", np.random.default_rng(0), episodes=2, seconds=1.0).train[0]
    with pytest.raises(SimulationError, match="30 Hz, the environment at 20 Hz"):
        replay(env, log)
    with pytest.raises(SimulationError, match="joints"):
        replay(env, log.with_(joints=tuple(f"other{i}" for i in range(14))))
    env.close()
    with pytest.raises(SimulationError, match="not an ALOHA environment"):
        replay(gym.make("CartPole-v1"), log)
