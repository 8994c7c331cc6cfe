"""Scripted experts: they fulfil every task with real contacts, and everything in the areas can be reached."""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.experts import other_robot
from embodiedreamer_gym.engines.table import TABLE_HEIGHT
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.experts.plan import READY, Planner, moved
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.envs.tasks.grips import downward, outward
from embodiedreamer_gym.envs.tasks.task import SIDES, Situation
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot.kinematics import Kinematics
from embodiedreamer_gym.robot.paths import SPEED, line
from embodiedreamer_gym.robot.paths import Path as Way
from tests.bank import robot
from tests.envs.moves import drain, shove

FASTEST = 0.5  # m/s, of a thing that is held; one that is squeezed out flies faster


@cache
def arm(side: str) -> Kinematics:
    model = robot("aloha")
    return Kinematics(model, model.arms[SIDES.index(side)])


def play(env: AlohaEnv, seed: int, steps: int = 300) -> tuple[list[np.ndarray], list[np.ndarray], list[dict]]:
    """An expert's episode: actions, observations, infos."""
    env.reset(seed=seed)
    expert = ScriptedExpert(env)
    actions, observations, infos = [], [], []
    for _ in range(steps):
        actions.append(expert.act())
        observation, *_, info = env.step(actions[-1])
        observations.append(observation)
        infos.append(info)
    return actions, observations, infos


# ---- they do it ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", TASKS)
def test_an_expert_fulfils_the_task_with_either_arm(task: str) -> None:
    env = AlohaEnv(task=task, obs_type="state")
    sides = set()
    for seed in range(50):
        side = env.reset(seed=seed)[1]["side"]
        if side in sides:
            continue
        sides.add(side)
        actions, _, infos = play(env, seed)
        assert infos[-1]["is_success"] and infos[-1]["grasp_success"], f"seed {seed}"
        first = next(k for k, info in enumerate(infos) if info["is_success"])
        assert all(info["is_success"] for info in infos[first + 30 :]), "it does not stay done"
        grasped = [info["grasp_success"] for info in infos]
        assert grasped == sorted(grasped), "a grasp is not forgotten"
        left = [info["remaining"] for info in infos]
        lifted = grasped.index(True)
        assert left[-1] == 0.0 < min(left[:first]) and max(np.diff(left[: lifted + 1])) < 0.03, "nearer all the while"
        assert left[lifted] == infos[lifted]["object_distance"] < left[lifted - 1] + 0.03
        assert all(action in env.action_space for action in actions)
        other = np.array(actions)[:, slice(7, 14) if side == "left" else slice(0, 7)]
        assert np.ptp(other, axis=0).max() == 0.0, "the other arm keeps still"
    assert sides == set(SIDES)
    env.close()


@pytest.mark.parametrize("task", TASKS)
def test_an_expert_fulfils_the_task_with_another_robot(task: str, tmp_path: Path) -> None:
    env = AlohaEnv(task=task, obs_type="state", robot=str(other_robot(tmp_path)))
    assert play(env, 3)[2][-1]["is_success"]
    env.close()


def test_an_expert_works_at_other_rates_and_through_wrappers() -> None:
    env = gym.make("EmbodieDreamer/GrabPaperCup-v0", obs_type="state", control_hz=50)
    env.reset(seed=1)
    expert = ScriptedExpert(env)
    assert [env.step(expert.act())[-1]["is_success"] for _ in range(250)][-1]
    env.close()


@pytest.mark.parametrize("task", TASKS)
def test_a_squeezed_object_is_neither_launched_nor_lost(task: str) -> None:
    """From when the fingers close to the end of lifting: slow, between the fingers, and not turned in them."""
    env = AlohaEnv(task=task, obs_type="state")
    env.reset(seed=2)
    expert, held = ScriptedExpert(env), []
    while len(held) < 40:
        env.step(expert.act())
        now = env.situation()
        assert now.speed < FASTEST
        if now.fingers == 2:
            place = now.tip.rotation.T @ (now.object.position - now.tip.position)
            held.append((*place, *(now.tip.rotation.T @ now.object.rotation[:, 0])))
        assert len(held) or env._steps < 150, "never grasped"
    slip = np.ptp(held[5:], axis=0)
    assert slip[:3].max() < 0.006 and slip[3:].max() < 0.15
    env.close()


def test_without_friction_nothing_is_lifted() -> None:
    """What holds a thing is the fingers' friction, not a constraint."""
    env = AlohaEnv(task="PutRemoteInBox", obs_type="state")
    env.engine.client.changeDynamics(env.engine.bodies["remote"], -1, lateralFriction=0.0)
    infos = play(env, 3, 150)[2]
    assert any(info["contacts"] == 2 for info in infos), "it was not even touched"
    assert not infos[-1]["grasp_success"]
    env.close()


def test_no_part_of_the_arm_but_the_fingers_touches_anything() -> None:
    for task in TASKS:
        env = AlohaEnv(task=task, obs_type="state")
        fingers = {env.engine.plant.links[finger] for side in env.engine.fingers for finger in side}
        env.reset(seed=11)
        expert = ScriptedExpert(env)
        for _ in range(250):
            env.step(expert.act())
            for body in env.engine.plant.ids:
                points = env.engine.client.getContactPoints(bodyA=body)
                assert {(p[1], p[3]) for p in points} <= fingers
        env.close()


def test_fingers_are_counted_for_the_arm_that_acts() -> None:
    env = AlohaEnv(task="GrabPaperCup", obs_type="state")
    for seed in (0, 1, 2, 3):
        infos = play(env, seed, 130)[2]
        assert infos[-1]["contacts"] == 2 and infos[0]["contacts"] == 0
        env._side = next(side for side in SIDES if side != env.side)
        assert env.situation().fingers == 0, "the other arm holds nothing"
    env.close()


def test_an_episode_of_grasps_is_the_same_whatever_went_before() -> None:
    for task in ("PutPenInCup", "PutCupOnMat"):
        new, old = (AlohaEnv(task=task, obs_type="state") for _ in range(2))
        actions, seen, _ = play(new, 4)
        play(old, 4, 137)  # ends with the object in the hand
        old.reset(seed=5)
        drain(shove(old, np.random.default_rng(0), 30))
        assert all(np.array_equal(a, b) for a, b in zip(actions, play(old, 4)[0], strict=True)), "the expert differs"
        old.reset(seed=4)
        again = [old.step(action)[0] for action in actions]
        assert all(np.array_equal(a, b) for a, b in zip(seen, again, strict=True))
        new.close()
        old.close()


# ---- they can reach everything -------------------------------------------------------------------------------------


def standing(task, side: str, places: dict[str, Pose]) -> Situation:
    """A reset's situation, without any physics."""
    position, rotation = arm(side).pose(home(robot("aloha"))[:6])
    thing = places[task.object.name]
    return Situation(
        side=side, base=arm(side).base, tip=Pose(position, Rotation.from_matrix(rotation).as_quat()), object=thing,
        goal=places[task.goal.name] if task.goal else thing, start=thing, speed=0.0, fingers=0, on_goal=False,
        on_table=True, grasped=False,
    )  # fmt: skip


def reachable(task, side: str, places: dict[str, Pose]) -> bool:
    now = standing(task, side, places)
    return Planner(arm(side), task).pick(now, home(robot("aloha"))[:6]) is not None


def grid(area, count: int, yaws: int, side: str) -> list[Pose]:
    """Poses over an area, its corners among them."""
    sign = 1.0 if side == "left" else -1.0
    points = product(*(np.linspace(*ends, count) for ends in area), np.arange(yaws) * 2 * np.pi / yaws + 0.2)
    return [
        Pose(np.array([x, sign * y, TABLE_HEIGHT]), Rotation.from_euler("z", yaw).as_quat()) for x, y, yaw in points
    ]


@pytest.mark.parametrize("name", TASKS)
def test_every_place_of_the_areas_is_reached(name: str) -> None:
    """The object over a grid of its area with the goal in the middle of its own, then the goal likewise."""
    task = TASKS[name]()
    round_things = name in ("GrabPaperCup", "PutCupOnMat")
    for side, yaws in (("left", 1 if round_things else 4), ("right", 1)):
        objects = grid(task.area, 3, yaws, side)
        goals = grid(task.goal_area or task.area, 3, (yaws + 1) // 2, side)
        middle = goals[len(goals) // 2]
        for where in objects:
            places = {task.object.name: where} | ({task.goal.name: middle} if task.goal else {})
            assert reachable(task, side, places), f"{side} {where.position}"
        for where in goals if task.goal else []:
            places = {task.object.name: objects[0], task.goal.name: where}
            assert reachable(task, side, places), f"{side} goal {where.position}"


@pytest.mark.parametrize("name", TASKS)
def test_what_is_drawn_is_reached(name: str) -> None:
    task, rng = TASKS[name](), np.random.default_rng(7)
    for _ in range(25):
        assert reachable(task, *task.place(rng))


# ---- their parts ---------------------------------------------------------------------------------------------------


def test_a_path_starts_and_ends_at_rest_and_keeps_its_speed() -> None:
    knots = np.cumsum(np.random.default_rng(0).normal(size=(6, 6)), axis=0)
    way = Way(knots)
    times = np.linspace(0.0, way.seconds, 200)
    angles, speeds = (np.array(x) for x in zip(*(way.at(t) for t in times), strict=True))
    np.testing.assert_allclose(angles[[0, -1]], knots[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(speeds[[0, -1]], 0.0, atol=1e-9)
    assert np.abs(speeds).max() < SPEED * 1.01
    np.testing.assert_allclose(np.gradient(angles, times, axis=0)[1:-1], speeds[1:-1], atol=0.02)
    assert np.array_equal(way.at(way.seconds + 1.0)[0], way.end)
    assert repr(way).startswith("Path(")


def test_a_line_is_straight() -> None:
    left = arm("left")
    position, rotation = left.pose(READY)
    end = Pose(position - [0.0, 0.0, 0.1], Rotation.from_matrix(rotation).as_quat())
    way = line(left, READY, end, 0.2)
    assert way is not None and way.seconds > 0.1 / 0.2
    for t in np.linspace(0.0, way.seconds, 20):
        at, turned = left.pose(way.at(t)[0])
        assert np.linalg.norm((at - position)[:2]) < 1e-3 and np.abs(turned - rotation).max() < 5e-3
    assert line(left, READY, moved(end, up=5.0), 0.2) is None


def test_gripper_poses_point_where_they_say() -> None:
    task = TASKS["PutCupOnMat"]()
    side, places = task.place(np.random.default_rng(0))
    now = standing(task, side, places)
    out = outward(now, now.goal.position, 0.5)
    away = (now.goal.position - now.base) * [1.0, 1.0, 0.0]
    assert out.rotation[:, 2] @ away == pytest.approx(np.cos(0.5) * np.linalg.norm(away))
    assert out.rotation[2, 2] == pytest.approx(-np.sin(0.5)) and out.rotation[2, 1] == pytest.approx(0.0)
    down = downward(now.goal.position, np.array([1.0, 2.0, 5.0]))
    np.testing.assert_allclose(down.rotation[:, 2], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(down.rotation[:, 1], np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0))
    for pose in (out, down):
        np.testing.assert_allclose(np.linalg.det(pose.rotation), 1.0)


@pytest.mark.parametrize("name", ["PutPenInCup", "PutRemoteInBox"])
def test_a_grip_depends_on_what_can_be_seen(name: str) -> None:
    """A thing the other way round is gripped in the same place, with the gripper turned by no more than a quarter."""
    task, rng, turn = TASKS[name](), np.random.default_rng(3), Rotation.from_euler("z", np.pi)
    for _ in range(20):
        side, places = task.place(rng)
        there = places[task.object.name]
        back = Pose(there.position, (Rotation.from_quat(there.quaternion) * turn).as_quat())
        first, other = (
            next(iter(task.grips(standing(task, side, places | {task.object.name: pose})))) for pose in (there, back)
        )
        np.testing.assert_allclose(first.position, other.position, atol=1e-9)
        np.testing.assert_allclose(first.rotation, other.rotation, atol=1e-9)
        away = there.position - arm(side).base
        assert first.rotation[:2, 0] @ away[:2] <= 0.0  # as an arm that faces it has its gripper


def test_an_expert_wants_an_aloha_environment_that_has_been_reset() -> None:
    with pytest.raises(SimulationError, match="not an ALOHA environment"):
        ScriptedExpert(gym.make("CartPole-v1"))
    env = AlohaEnv(obs_type="state")
    with pytest.raises(gym.error.ResetNeeded):
        ScriptedExpert(env)
    env.close()


def test_an_expert_that_cannot_reach_keeps_still() -> None:
    env = AlohaEnv(task="GrabPaperCup", obs_type="state")
    env.reset(seed=0)
    env.engine.client.resetBasePositionAndOrientation(env.engine.bodies["cup"], (0.6, 0.0, 2.5), (0, 0, 0, 1))
    expert = ScriptedExpert(env)
    actions = np.array([expert.act() for _ in range(5)])
    np.testing.assert_allclose(actions, np.tile(home(env.robot), (5, 1)), atol=1e-6)
    env.close()
