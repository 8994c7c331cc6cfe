"""Table and props in MuJoCo: as heavy, large and slippery as the tasks say, and only what shall touch touches."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.standin.bench.world import Bench

UPRIGHT = [1.0, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def bench() -> Bench:
    """A pen, its holder and a robot."""
    return Bench(TASKS["PutPenInCup"](), None, None, 30)


def drop(bench: Bench, name: str, where: list[float], quaternion: list[float]) -> np.ndarray:
    """Where (7,) a prop comes to rest."""
    data = bench.engine.data
    data.joint(name).qpos = [*where, *quaternion]
    bench.engine.refresh()
    bench.engine.advance(lambda t: np.tile(bench.home, (len(t), 1)), 3000)
    assert np.abs(data.joint(name).qvel).max() < 0.01
    return data.joint(name).qpos.copy()


def test_props_weigh_and_slip_as_the_tasks_say(bench: Bench) -> None:
    model = bench.engine.model
    for prop in bench.task.props:
        body = model.body(prop.name)
        assert body.mass[0] == pytest.approx(prop.mass)
        np.testing.assert_allclose(body.ipos, prop.centre)
        assert int(body.dofnum[0]) == (0 if prop.fixed else 6)
        for geom in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
            assert model.geom_friction[geom, 0] == prop.friction and model.geom_priority[geom] == 1
    pads = model.geom_friction[model.geom_bodyid == model.body("left_finger1").id, 0]
    np.testing.assert_array_equal(pads, [1.0, 1.0])


def test_links_touch_things_but_not_each_other(bench: Bench) -> None:
    rng = np.random.default_rng(0)
    bench.reset(*bench.task.place(rng))
    data, model = bench.engine.data, bench.engine.model
    data.qpos[model.joint("left_joint3").qposadr[0]] -= 1.2  # folded onto itself
    bench.engine.refresh()
    bodies = {model.body(int(i)).name for i in model.geom_bodyid[data.contact.geom].ravel()}
    assert not any(name.startswith(("left", "right")) for name in bodies)
    data.qpos[model.joint("left_joint2").qposadr[0]] += 1.5  # and down into the table
    bench.engine.refresh()
    bodies = {model.body(int(i)).name for i in model.geom_bodyid[data.contact.geom].ravel()}
    assert "table" in bodies and any(name.startswith("left") for name in bodies)


def test_joints_stop_at_their_limits(bench: Bench) -> None:
    bench.reset(*bench.task.place(np.random.default_rng(0)))
    target = bench.home + np.array([0.0] * 6 + [0.5] + [0.0] * 6 + [-1.5])
    for _ in range(40):
        bench.play(target)
    grippers = bench.engine.encoders()[[6, 13]]
    np.testing.assert_allclose(grippers, [1.0, 0.0], atol=0.02)


def test_a_pen_rests_on_the_table_and_stands_in_its_holder(bench: Bench) -> None:
    side, poses = bench.task.place(np.random.default_rng(0))
    bench.reset(side, poses)
    lying = drop(bench, "pen", [0.6, 0.0, 0.76], UPRIGHT)
    assert lying[2] == pytest.approx(0.74, abs=3e-4)
    now = bench.situation()
    assert now.on_table and not now.on_goal and now.fingers == 0 and now.speed < 0.005
    x, y = poses["holder"].position[:2]
    standing = drop(bench, "pen", [x, y, 0.74 + 0.12], [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    assert 0.74 + 0.05 < standing[2] < 0.74 + 0.12 and np.hypot(*(standing[:2] - [x, y])) < 0.05
    assert bench.situation().on_goal and not bench.situation().on_table


@pytest.mark.parametrize(("name", "height"), [("PutCupOnMat", 0.004), ("GrabPaperCup", 0.0)])
def test_a_cup_stands_still_for_seconds(name: str, height: float) -> None:
    """On many points of its base, on the table and on the mat."""
    bench = Bench(TASKS[name](), None, None, 30)
    side, poses = bench.task.place(np.random.default_rng(1))
    bench.reset(side, poses)
    x, y = poses[bench.task.props[-1].name].position[:2]
    stood = drop(bench, "cup", [x, y, 0.74 + height + 0.001], UPRIGHT)
    np.testing.assert_allclose(stood[:3], [x, y, 0.74 + height], atol=5e-4)
    np.testing.assert_allclose(np.abs(stood[3:]), UPRIGHT, atol=1e-3)
    bench.engine.advance(lambda t: np.tile(bench.home, (len(t), 1)), 4000)
    np.testing.assert_allclose(bench.engine.data.joint("cup").qpos, stood, atol=2e-4)
