"""The tasks: where props stand, what counts as done, and whether the things behave as things do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.engines.table import TABLE, TABLE_CENTRE, TABLE_HEIGHT
from embodiedreamer_gym.envs import NAMES
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.experts.plan import READY
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.envs.tasks import TASKS, Task
from embodiedreamer_gym.envs.tasks.attempt import Attempt
from embodiedreamer_gym.envs.tasks.grips import outward
from embodiedreamer_gym.envs.tasks.task import GAP, SIDES
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot.kinematics import Kinematics

CENTRE = (0.5, 0.3)  # m, in front of the left arm


@pytest.fixture(params=TASKS)
def env(request) -> Iterator[AlohaEnv]:
    made = AlohaEnv(task=request.param, obs_type="state")
    yield made
    made.close()


def pose(x: float, y: float, z: float = 0.0, turn: Rotation | None = None) -> Pose:
    """Where a prop's origin is, above the table."""
    turn = Rotation.identity() if turn is None else turn
    return Pose(np.array([x, y, TABLE_HEIGHT + z]), turn.as_quat())


def put(env: AlohaEnv, thing: Pose, seconds: float = 1.5, grasped: bool = True) -> dict:
    """Let the object go over a goal at the centre, as if it had been picked up; how things are in the end."""
    env.reset(seed=next(s for s in range(20) if env.reset(seed=s)[1]["side"] == "left"))
    poses = {env.task.object.name: thing}
    if env.task.goal:
        poses[env.task.goal.name] = pose(*CENTRE)
    rest = home(env.robot)
    env.engine.reset(rest, np.zeros_like(rest), rest, poses)
    env._attempt.grasped, info = grasped, {}
    for _ in range(round(seconds * env.control_hz)):
        info = env.step(rest)[-1]
    return info


# ---- where things stand --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TASKS)
def test_props_stand_apart_in_their_areas_on_the_table(name: str) -> None:
    task, rng = TASKS[name](), np.random.default_rng(0)
    seen = []
    for _ in range(300):
        side, poses = task.place(rng)
        sign = 1.0 if side == "left" else -1.0
        for prop in task.props:
            (x0, x1), (y0, y1) = (prop is task.goal and task.goal_area) or task.area
            x, y, z = poses[prop.name].position
            assert x0 <= x <= x1 and y0 <= sign * y <= y1 and z == TABLE_HEIGHT
            reach = np.array([x, y]) - TABLE_CENTRE[:2]
            assert np.all(np.abs(reach) + prop.radius < np.array(TABLE.size[:2]) / 2), "it stands over the edge"
        places = [p.position for p in poses.values()]
        if len(places) == 2:
            assert np.linalg.norm(places[0] - places[1]) > GAP + sum(p.radius for p in task.props)
        seen.append((side, *places[0][:2]))
    sides, xs, ys = zip(*seen, strict=True)
    assert {sides.count(side) > 100 for side in SIDES} == {True}
    (x0, x1), (y0, y1) = task.area
    assert np.ptp(xs) > 0.9 * (x1 - x0) and np.ptp(np.abs(ys)) > 0.9 * (y1 - y0), "the area is not used"


@pytest.mark.parametrize("name", TASKS)
def test_the_head_camera_sees_every_prop_wherever_it_stands(name: str) -> None:
    camera, task = CAMERAS["head"], TASKS[name]()
    eye, turn = camera.pose()
    around = np.linspace(0.0, 2 * np.pi, 40)
    for prop in task.props:
        xs, ys = (prop is task.goal and task.goal_area) or task.area
        for x, y, sign, height in product(xs, ys, (-1.0, 1.0), (0.0, prop.size[2])):
            rim = np.stack([x + prop.radius * np.cos(around), sign * y + prop.radius * np.sin(around)], axis=1)
            seen = (np.column_stack([rim, np.full(40, TABLE_HEIGHT + height)]) - eye) @ turn @ camera.matrix().T
            pixels = seen[:, :2] / seen[:, 2:]
            assert np.all(pixels > 0) and np.all(pixels < camera.size), f"{prop.name} at {x}, {sign * y}"


def test_the_same_draws_give_the_same_places() -> None:
    for name in TASKS:
        one, two = (TASKS[name]().place(np.random.default_rng(5)) for _ in range(2))
        assert one[0] == two[0]
        assert all(np.array_equal(one[1][k].position, two[1][k].position) for k in one[1])


def test_an_area_without_room_is_an_error() -> None:
    class Cramped(TASKS["PutRemoteInBox"]):
        area = goal_area = ((0.5, 0.55), (0.3, 0.35))

    with pytest.raises(SimulationError, match="task Cramped has no room for its props"):
        Cramped().place(np.random.default_rng(0))


def test_every_task_has_an_id_and_says_what_it_wants() -> None:
    assert set(NAMES) == set(TASKS)
    for name, task in TASKS.items():
        assert task.__name__ == name and task.description and issubclass(task, Task)
        assert len({prop.name for prop in task().props}) == len(task().props)


# ---- how things behave ---------------------------------------------------------------------------------------------


def test_what_nobody_touches_stays_where_it_is(env: AlohaEnv) -> None:
    for seed in range(2):
        env.reset(seed=seed)
        rest, start = home(env.robot), env.situation()
        for _ in range(300):
            env.step(rest)
        end = env.situation()
        assert np.linalg.norm(end.object.position - start.object.position) < 1e-3
        assert np.abs(end.object.rotation - start.object.rotation).max() < 0.02
        assert np.linalg.norm(end.goal.position - start.goal.position) < 1e-3
        assert end.speed < 2e-3 and end.on_table and not end.grasped and end.fingers == 0


def test_an_object_stands_on_the_table_not_in_it(env: AlohaEnv) -> None:
    env.reset(seed=0)
    for _ in range(60):
        env.step(home(env.robot))
    assert abs(env.situation().object.position[2] - TABLE_HEIGHT) < 2e-4


CUPS = {
    "in the middle": (0.0, 0.006, 0.0, True),
    "wholly on it, at its rim": (0.036, 0.006, 0.0, True),
    "half on it": (0.065, 0.006, 0.0, False),
    "dropped from 2 cm, in the middle": (0.0, 0.024, 0.0, True),
    "dropped from 2 cm, beside it": (0.065 + 0.026 + 0.02, 0.02, 0.0, False),
    "upside down": (0.0, 0.091, np.pi, False),
    "lying on it": (-0.04, 0.04, np.pi / 2, False),
}


@pytest.mark.parametrize("case", CUPS)
def test_when_a_cup_is_on_the_mat(case: str) -> None:
    off, height, tilt, done = CUPS[case]
    env = AlohaEnv(task="PutCupOnMat", obs_type="state")
    info = put(env, pose(CENTRE[0] + off, CENTRE[1], height, Rotation.from_euler("y", tilt)))
    assert info["is_success"] is info["task_success"] is done
    env.close()


PENS = {
    "upright": ((0.0, 0.0, 0.1), -np.pi / 2, True),
    "leaning": ((0.0, 0.0, 0.12), -np.pi / 2 + 0.3, True),
    "across the rim": ((0.0, 0.0, 0.102), 0.0, False),
    "beside it": ((0.1, 0.0, 0.002), 0.0, False),
}


@pytest.mark.parametrize("case", PENS)
def test_when_a_pen_is_in_the_holder(case: str) -> None:
    (x, y, z), pitch, done = PENS[case]
    env = AlohaEnv(task="PutPenInCup", obs_type="state")
    info = put(env, pose(CENTRE[0] + x, CENTRE[1] + y, z, Rotation.from_euler("y", pitch)))
    assert info["is_success"] is done
    env.close()


REMOTES = {
    "inside": ((0.0, 0.0, 0.02), (0.0, 0.0, 0.0), True),
    "inside, askew": ((0.0, 0.0, 0.02), (0.0, 0.0, 0.4), True),
    "on the rim": ((0.0, 0.0, 0.072), (0.0, 0.0, np.pi / 2), False),
    "leaning out": ((0.06, 0.0, 0.08), (0.0, -0.6, 0.0), False),
    "beside it": ((0.0, 0.15, 0.002), (0.0, 0.0, 0.0), False),
}


@pytest.mark.parametrize("case", REMOTES)
def test_when_a_remote_is_in_the_box(case: str) -> None:
    (x, y, z), turn, done = REMOTES[case]
    env = AlohaEnv(task="PutRemoteInBox", obs_type="state")
    info = put(env, pose(CENTRE[0] + x, CENTRE[1] + y, z, Rotation.from_euler("xyz", turn)))
    assert info["is_success"] is done
    env.close()


def test_what_was_never_picked_up_is_no_success() -> None:
    """Pushed onto the mat, or thrown there: the end looks right, but nobody has grasped it."""
    env = AlohaEnv(task="PutCupOnMat", obs_type="state")
    info = put(env, pose(*CENTRE, 0.006), grasped=False)
    assert not info["is_success"] and not info["grasp_success"]
    assert env.task.done(env.situation()), "only the grasp is missing"
    env.close()


def test_a_held_object_is_not_done_until_it_is_let_go_and_at_rest() -> None:
    env = AlohaEnv(task="PutCupOnMat", obs_type="state")
    put(env, pose(*CENTRE, 0.006))
    now = env.situation()
    assert env.task.done(now)
    assert not env.task.done(replace(now, fingers=1))
    assert not env.task.done(replace(now, speed=0.1))
    assert not env.task.done(replace(now, on_goal=False))
    env.close()


def test_picked_up_means_held_by_both_fingers_off_the_table_and_up() -> None:
    env = AlohaEnv(task="GrabPaperCup", obs_type="state")
    env.reset(seed=0)
    now, task = env.situation(), env.task
    up = Pose(now.object.position + np.array([0.0, 0.0, 0.05]), now.object.quaternion)
    held = replace(now, object=up, fingers=2, on_table=False)
    assert task.picked_up(held) and task.done(held)
    for less in ({"fingers": 1}, {"on_table": True}, {"object": now.object}):
        assert not task.picked_up(replace(held, **less))
    env.close()


def test_what_remains_is_the_way_to_the_object_then_that_of_the_object() -> None:
    """The nearest that the gripper came counts, not where it is now; what was picked up and is lost counts by its own way."""
    env = AlohaEnv(task="PutCupOnMat", obs_type="state")
    env.reset(seed=0)
    now, attempt = env.situation(), Attempt(env.task)
    away = float(np.linalg.norm(now.object.position - now.goal.position))

    def remaining(off: float, **changes: object) -> float:
        tip = Pose(env.task.handle(now) + np.array([off, 0.0, 0.0]), now.tip.quaternion)
        seen = replace(now, tip=tip, **changes)
        attempt.see(seen)
        return attempt.info(seen, env.task.target(seen), 0.0)["remaining"]

    assert remaining(0.2) == pytest.approx(away + 0.2)
    assert remaining(0.05) == pytest.approx(away + 0.05)
    assert remaining(0.4) == pytest.approx(away + 0.05)
    up = Pose(now.object.position + np.array([0.0, 0.0, 0.05]), now.object.quaternion)
    assert remaining(0.0, object=up, fingers=2, on_table=False) == pytest.approx(np.hypot(away, 0.05), rel=1e-2)
    assert remaining(0.3) == pytest.approx(away), "lost"
    assert remaining(0.3, object=now.goal, on_goal=True, on_table=False) == 0.0
    env.close()


def test_a_pushed_object_moves_and_counts_for_nothing(env: AlohaEnv) -> None:
    """A closed hand sweeps low over the table, through where the object stands."""
    env.reset(seed=0)
    side, now = SIDES.index(env.side), env.situation()
    arm = Kinematics(env.robot, env.robot.arms[side])
    aside = outward(now, now.object.position, 1.2).rotation[:, 1]
    action, angles, moved = home(env.robot), READY, 0.0
    for share in np.concatenate([np.full(60, -1.0), np.linspace(-1.0, 1.0, 90)]):
        place = now.object.position + 0.12 * share * aside + [0.0, 0.0, 0.02]
        angles = arm.solve(place, outward(now, place, 1.2).rotation, angles)
        assert angles is not None
        action[arm.joints], action[7 * side + 6] = angles, 0.0
        info = env.step(action)[-1]
        assert not info["grasp_success"] and not info["is_success"]
        moved = max(moved, float(np.linalg.norm(env.situation().object.position - now.object.position)))
    assert moved > 0.03, "the hand has missed it"


@pytest.mark.parametrize("name", [name for name in TASKS if TASKS[name].goal])
def test_the_target_is_where_an_expert_lets_go(name: str) -> None:
    """Of one that holds the object as it grips it, to the few mm by which it sags or is set down."""
    task = TASKS[name]()
    env = AlohaEnv(task=name, obs_type="state")
    for seed in range(4):
        env.reset(seed=seed)
        now = env.situation()
        gripped = replace(now, tip=next(task.grips(now)))
        places = [release.position for release in task.releases(gripped)]
        assert min(np.linalg.norm(place - task.target(now)) for place in places) < 5e-3
    env.close()
