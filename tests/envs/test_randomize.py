"""Robots drawn from the intervals of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.robots import draw_parameters
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot import RobotModel
from tests.envs.moves import drain, shove

PAYLOAD = "payload.mass"


def calibrated(folder: Path) -> str:
    """A robot file with a payload of 0.1 kg on both arms, and intervals of masses, stiffness and one friction."""
    model = RobotModel.load("aloha").with_effect("payload").with_effect("coulomb_friction")
    intervals = {f"stiffness[{j}]": (0.9 * p, 1.1 * p) for j, p in zip(model.joints, model.stiffness, strict=True)}
    intervals |= {f"{PAYLOAD}[{arm}]": (0.05, 0.15) for arm in model.arms}
    intervals["coulomb_friction.torque[left_joint2]"] = (0.1, 0.3)
    values = {PAYLOAD: dict.fromkeys(model.arms, 0.1), "coulomb_friction.torque": {"left_joint2": 0.2}}
    model.with_values(values, intervals).save(folder / "calibrated.json")
    return str(folder / "calibrated.json")


@pytest.fixture
def robot(tmp_path: Path) -> str:
    return calibrated(tmp_path)


def hang(env: AlohaEnv, seed: int | None = None) -> np.ndarray:
    """Where the joints (14,) are after a second of holding still."""
    env.reset(seed=seed)
    hold = env.joint_positions()
    for _ in range(30):
        env.step(hold)
    return env.joint_positions() - hold


def test_each_reset_draws_another_robot(robot: str) -> None:
    env = AlohaEnv(obs_type="state", robot=robot, randomize="calibration")
    sag = np.array([hang(env, seed) for seed in range(6)])
    env.close()
    loaded = sag[:, [1, 2, 8, 9]]  # the joints that carry the arms
    assert len(np.unique(loaded, axis=0)) == 6
    spread = np.ptp(loaded, axis=0) / np.abs(loaded).mean(axis=0)
    assert (spread > 0.02).all() and (spread < 0.5).all()


def test_equal_seeds_draw_equal_robots(robot: str) -> None:
    one, two = (AlohaEnv(obs_type="state", robot=robot, randomize="calibration") for _ in range(2))
    two.reset(seed=1)
    drain(shove(two, np.random.default_rng(0), 20))
    for seed in (3, None):  # the next episode of the same sequence too
        np.testing.assert_array_equal(hang(one, seed), hang(two, seed))
    one.close(), two.close()


def test_without_it_the_best_fit_is_kept(robot: str) -> None:
    best = AlohaEnv(obs_type="state", robot=robot)
    sag = np.array([hang(best, seed) for seed in range(3)])
    assert (sag == sag[0]).all()
    drawn = AlohaEnv(obs_type="state", robot=robot, randomize="calibration")
    assert all((hang(drawn, seed) != sag[0]).any() for seed in range(3))
    best.close(), drawn.close()


def test_what_is_drawn_lies_inside_the_intervals_around_the_fit(robot: str) -> None:
    model = RobotModel.load(robot)
    rng = np.random.default_rng(0)
    draws = [{str(group): values for group, values in draw_parameters(model, rng).items()} for _ in range(400)]
    assert draws[0].keys() == {"stiffness", PAYLOAD, "coulomb_friction.torque"}
    for group, low, high, best in (
        ("stiffness", 0.9 * model.stiffness, 1.1 * model.stiffness, model.stiffness),
        (PAYLOAD, [0.05] * 2, [0.15] * 2, [0.1] * 2),
    ):
        drawn = np.concatenate([draw[group] for draw in draws])
        assert (drawn >= low).all() and (drawn <= high).all() and np.ptp(drawn, axis=0).min() > 0
        np.testing.assert_allclose(drawn.mean(axis=0), best, rtol=0.03)
        inner = np.abs(drawn - best) < 0.5 * np.subtract(high, low) / 2
        assert 0.55 < inner.mean() < 0.80  # of a normal distribution 67 % lie within half of a 95 % interval
    friction = np.concatenate([draw["coulomb_friction.torque"] for draw in draws])
    assert np.ptp(friction[:, model.joints.index("left_joint2")]) > 0.1
    others = np.delete(friction, model.joints.index("left_joint2"), axis=1)
    assert (others == others[0]).all()


def test_masses_are_felt(robot: str) -> None:
    """Nothing but the payload is drawn: what hangs at the arm makes it sag."""
    model = RobotModel.load(robot)
    only = {name: pair for name, pair in model.intervals.items() if name.startswith("payload")}
    model.with_(intervals=only).save(robot)
    env = AlohaEnv(obs_type="state", robot=robot, randomize="calibration")
    hand, sag, mass = model.nominal_mechanics.tip_body[0], [], []
    for seed in range(8):
        sag.append(abs(hang(env, seed)[1]))
        mass.append(env.engine.plant.drive.mechanics.mass[0, hand] - model.tree.mass[hand])
    env.close()
    assert len(set(mass)) == 8 and min(mass) >= 0.05 and max(mass) <= 0.15
    assert np.argsort(mass).tolist() == np.argsort(sag).tolist()


def test_a_robot_without_intervals_is_refused() -> None:
    with pytest.raises(ModelError, match=r"randomize='calibration' needs .* aloha has none; calibrate it first"):
        AlohaEnv(randomize="calibration")


def test_intervals_of_parameters_that_the_robot_no_longer_has_are_left_alone(robot: str) -> None:
    model = RobotModel.load(robot)
    model = model.with_(intervals={**model.intervals, "stribeck_friction.torque[left_joint1]": (0.0, 1.0)})
    drawn = draw_parameters(model, np.random.default_rng(0))
    assert "stribeck_friction" not in {group.effect for group in drawn} and len(drawn) == 3
