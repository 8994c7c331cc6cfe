"""Table and props in MuJoCo: as heavy, large and slippery as the tasks say, and only what shall touch touches."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.standin.bench import StandInWorld

UPRIGHT = [1.0, 0.0, 0.0, 0.0]


def world(task: str) -> AlohaEnv:
    return AlohaEnv(task, obs_type="state", engine=StandInWorld(seed_of_robot=None, pictures="none"))


@pytest.fixture(scope="module")
def bench() -> AlohaEnv:
    """A pen, its holder and a robot."""
    return world("PutPenInCup")


def drop(bench: AlohaEnv, name: str, where: list[float], quaternion: list[float]) -> np.ndarray:
    """Where (7,) a prop comes to rest."""
    data = bench.engine.engine.data
    data.joint(name).qpos = [*where, *quaternion]
    bench.engine.engine.refresh()
    bench.engine.engine.advance(lambda t: np.tile(home(bench.robot), (len(t), 1)), 3000)
    assert np.abs(data.joint(name).qvel).max() < 0.01
    return data.joint(name).qpos.copy()


def test_props_weigh_and_slip_as_the_tasks_say(bench: AlohaEnv) -> None:
    model = bench.engine.engine.model
    for prop in bench.task.props:
        body = model.body(prop.name)
        assert body.mass[0] == pytest.approx(prop.mass)
        np.testing.assert_allclose(body.ipos, prop.centre)
        assert int(body.dofnum[0]) == (0 if prop.fixed else 6)
        for geom in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
            assert model.geom_friction[geom, 0] == prop.friction and model.geom_priority[geom] == 1
    pads = model.geom_friction[model.geom_bodyid == model.body("left_finger1").id, 0]
    np.testing.assert_array_equal(pads, [1.0, 1.0])


def test_links_touch_things_but_not_each_other(bench: AlohaEnv) -> None:
    rng = np.random.default_rng(0)
    bench.reset(seed=int(rng.integers(100)))
    data, model = bench.engine.engine.data, bench.engine.engine.model
    data.qpos[model.joint("left_joint3").qposadr[0]] -= 1.2  # folded onto itself
    bench.engine.engine.refresh()
    bodies = {model.body(int(i)).name for i in model.geom_bodyid[data.contact.geom].ravel()}
    assert not any(name.startswith(("left", "right")) for name in bodies)
    data.qpos[model.joint("left_joint2").qposadr[0]] += 1.5  # and down into the table
    bench.engine.engine.refresh()
    bodies = {model.body(int(i)).name for i in model.geom_bodyid[data.contact.geom].ravel()}
    assert "table" in bodies and any(name.startswith("left") for name in bodies)


def test_joints_stop_at_their_limits(bench: AlohaEnv) -> None:
    bench.reset(seed=0)
    target = home(bench.robot) + np.array([0.0] * 6 + [0.5] + [0.0] * 6 + [-1.5])
    for _ in range(40):
        bench.engine.advance(target)
    grippers = bench.joint_positions()[[6, 13]]
    np.testing.assert_allclose(grippers, [1.0, 0.0], atol=0.02)


def test_a_pen_rests_on_the_table_and_stands_in_its_holder(bench: AlohaEnv) -> None:
    bench.reset(seed=0)
    lying = drop(bench, "pen", [0.6, 0.0, 0.76], UPRIGHT)
    assert lying[2] == pytest.approx(0.74, abs=3e-4)
    now = bench.situation()
    assert now.on_table and not now.on_goal and now.fingers == 0 and now.speed < 0.005
    x, y = bench.object_pose("holder").position[:2]
    standing = drop(bench, "pen", [x, y, 0.74 + 0.12], [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    assert 0.74 + 0.05 < standing[2] < 0.74 + 0.12 and np.hypot(*(standing[:2] - [x, y])) < 0.05
    assert bench.situation().on_goal and not bench.situation().on_table


@pytest.mark.parametrize(("name", "height"), [("PutCupOnMat", 0.004), ("GrabPaperCup", 0.0)])
def test_a_cup_stands_still_for_seconds(name: str, height: float) -> None:
    """On many points of its base, on the table and on the mat."""
    bench = world(name)
    bench.reset(seed=1)
    x, y = bench.object_pose(bench.task.props[-1].name).position[:2]
    stood = drop(bench, "cup", [x, y, 0.74 + height + 0.001], UPRIGHT)
    np.testing.assert_allclose(stood[:3], [x, y, 0.74 + height], atol=5e-4)
    np.testing.assert_allclose(np.abs(stood[3:]), UPRIGHT, atol=1e-3)
    bench.engine.engine.advance(lambda t: np.tile(home(bench.robot), (len(t), 1)), 4000)
    np.testing.assert_allclose(bench.engine.engine.data.joint("cup").qpos, stood, atol=2e-4)
