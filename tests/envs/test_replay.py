"""The spine: what is calibrated and diagnosed on logs is what a policy is trained in."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import embodiedreamer_gym as er
from embodiedreamer_gym.envs.replay import replay
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Recordings
from embodiedreamer_gym.standin.cases import aloha_case
from tests.bank import robot

ID = "EmbodieDreamer/PutCupOnMat-v0"
TOLERANCE = 1e-4  # rad, of each joint's rms


def joint_errors(path: Path, logs: Recordings, **arguments) -> np.ndarray:
    """Each joint's rms (14,) of logs whose commands went through env.step."""
    env = gym.make(ID, robot=str(path), obs_type="state", **arguments)
    errors = [np.where(log.usable, log.position - replay(env, log), 0.0) for log in logs]
    env.close()
    return np.sqrt(
        np.sum([(e**2).sum(0) for e in errors], axis=0) / np.sum([log.usable.sum(0) for log in logs], axis=0)
    )


@pytest.mark.slow
def test_logs_to_diagnosis_to_environment(tmp_path: Path) -> None:
    """HDF5 logs of a stand-in pair with a hidden effect, diagnosed, give an environment that errs as `compare` says."""
    case = aloha_case("coulomb_friction", "left", np.random.default_rng(7), "strong", episodes=4, seconds=8.0)
    model = er.RobotModel.load(case.write(tmp_path))
    train, test = (er.load_recordings(tmp_path / part / "*.hdf5", hz=30.0) for part in ("train", "test"))
    found = er.diagnose(model, train, test, max_effects=1)
    assert found.best == "coulomb_friction" and all(j.startswith("left") for j in found.joints["coulomb_friction"])
    found.model.save(tmp_path / "B.json")
    compared = er.compare(found.model, test).joint_rms[0]
    replayed = joint_errors(tmp_path / "B.json", test, collisions=False)
    assert np.abs(replayed - compared).max() < TOLERANCE
    data = json.loads((tmp_path / "B.json").read_text())
    assert data["effects"]
    (tmp_path / "B.json").write_text(json.dumps({**data, "effects": [], "intervals": {}}))
    without = joint_errors(tmp_path / "B.json", test, collisions=False)
    assert np.abs(without - compared).max() > 3 * TOLERANCE, "the effect in the file makes no difference"


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
    with pytest.raises(SimulationError, match="no ALOHA environment"):
        replay(gym.make("CartPole-v1"), log)
