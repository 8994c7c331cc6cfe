"""The MuJoCo engine: the drive of the fits, the same episodes after any history, the pictures of the other engine."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from embodiedreamer_gym.engines import engine_factory
from embodiedreamer_gym.engines.mujoco import rendering
from embodiedreamer_gym.engines.mujoco.bodies import MujocoBodies
from embodiedreamer_gym.engines.plant import Plant, replay
from embodiedreamer_gym.engines.robot_view import RobotView
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from tests.opengl import skip_without_pictures

EFFECTS = {"command_delay": 0.02, "coulomb_friction": 0.2, "torque_bias": 0.1, "payload": 0.1}


def rich(tmp_path: Any) -> str:
    """The path of an ALOHA with four effects."""
    model = RobotModel.load("aloha")
    for name in EFFECTS:
        model = model.with_effect(name)
    values: dict[str, dict[str, float]] = {}
    for row in model.parameters():
        effect = row.key.effect
        if effect in EFFECTS and row.key.parameter in ("seconds", "torque", "mass"):
            group = values.setdefault(str(row.key.group), {})
            group[row.key.place] = float(np.clip(EFFECTS[effect], row.low, row.high))
    model.with_values(values).save(tmp_path / "rich.json")
    return str(tmp_path / "rich.json")


def swing(seed: int, steps: int = 60) -> np.ndarray:
    """Smooth joint targets (steps, 14) around home, small enough not to touch anything."""
    rng, time = np.random.default_rng(seed), np.arange(steps)[:, None] / 30
    home = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 1.0] * 2)
    move = 0.25 * np.sin(2 * np.pi * time * rng.uniform(0.3, 1.0, 14) + rng.uniform(0, 6, 14))
    return home + move * np.array([1.0] * 6 + [0.0] + [1.0] * 6 + [0.0])


@pytest.mark.parametrize("name", ["aloha", "so101", "servo"])
def test_a_free_run_equals_its_replay_in_mujoco(name: str) -> None:
    model = RobotModel.load(name)
    time = np.arange(60) / 30
    start = np.clip(0.0, model.tree.lower + 0.3, model.tree.upper - 0.3) * np.ones(model.n)
    command = start + 0.1 * np.sin(3 * time)[:, None]
    log = Recording(name="log", joints=model.joints, time=time, position=command, command=command, units=model.units)
    bodies = MujocoBodies(model, 1 / 240, lambda spec: None)
    bodies.model.geom_contype[:], bodies.model.geom_conaffinity[:] = 0, 0
    plant = Plant(model, bodies)
    for run in (log, log.with_(gain=2.0), log):
        np.testing.assert_allclose(replay(plant, run).position, simulate(model, run).position, rtol=0, atol=1e-6)


def test_both_engines_move_the_robot_alike(tmp_path: Any) -> None:
    """With effects, within 0.1 mrad after two seconds."""
    pytest.importorskip("pybullet")
    robot, positions = rich(tmp_path), []
    for engine in ("bullet", "mujoco"):
        env = AlohaEnv(robot=robot, engine=engine, obs_type="state", collisions=False)
        env.reset(seed=0, options={"joint_positions": swing(0)[0]})
        rows = []
        for target in swing(0):
            env.step(target)
            rows.append(env.joint_positions())
        positions.append(np.array(rows))
        env.close()
    assert np.abs(positions[0] - positions[1]).max() < 1e-4
    assert np.ptp(positions[0], axis=0).max() > 0.3


def test_an_episode_is_the_same_whatever_went_before() -> None:
    env = AlohaEnv("PutCupOnMat", engine="mujoco", obs_type="state")
    runs = []
    for before in (0, 40):
        env.reset(seed=5)
        for target in swing(1, before):
            env.step(target - 0.4)
        observation, _ = env.reset(seed=3)
        rows = [observation, *(env.step(target)[0] for target in swing(2, 40))]
        runs.append(np.array(rows))
    np.testing.assert_array_equal(runs[0], runs[1])


@pytest.mark.parametrize("task", TASKS)
def test_the_expert_fulfils_every_task(task: str) -> None:
    env = AlohaEnv(task, engine="mujoco", obs_type="state")
    env.reset(seed=0)
    expert, info = ScriptedExpert(env), {}
    for _ in range(300):
        *_, info = env.step(expert.act())
    assert info["grasp_success"] and info["is_success"]


def test_gymnasium_finds_no_fault() -> None:
    env = gym.make("EmbodieDreamer/PutCupOnMat-v0", engine="mujoco", obs_type="state", disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*symmetric and normalized space")  # joint angles are neither
        check_env(env.unwrapped, skip_render_check=True)
    assert env.unwrapped.metadata["engine"] == "mujoco"


def test_what_is_pushed_off_the_table_does_not_fall_for_ever() -> None:
    env = AlohaEnv("GrabPaperCup", engine="mujoco", obs_type="state")
    env.reset(seed=0, options={"object_poses": {"cup": [1.2, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]}})
    for _ in range(60):
        env.step(env.command)
    assert -0.001 < env.object_pose("cup").position[2] < 0.1


def test_arms_touch_each_other_and_pass_through_without_collisions() -> None:
    crossed = np.array([-0.9, 1.9, -0.9, 0.0, 0.0, 0.0, 1.0, 0.9, 1.9, -0.9, 0.0, 0.0, 0.0, 1.0])
    ends = []
    for collisions in (True, False):
        env = AlohaEnv("GrabPaperCup", engine="mujoco", obs_type="state", collisions=collisions)
        env.reset(seed=0)
        for _ in range(90):
            env.step(crossed)
        ends.append(env.joint_positions())
    assert np.abs(ends[1] - crossed)[[0, 7]].max() < 0.05 and np.abs(ends[0] - ends[1]).max() > 0.02


# ---- pictures ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drawn() -> AlohaEnv:
    skip_without_pictures()
    env = AlohaEnv("PutCupOnMat", engine="mujoco", image_size=(160, 120))
    env.reset(seed=0)
    return env


def test_pictures_show_what_the_other_engine_shows(drawn: AlohaEnv) -> None:
    """The same classes in 99 % of the pixels, the same depth; of the world and of the hand."""
    pytest.importorskip("pybullet")
    other = AlohaEnv("PutCupOnMat", engine="bullet", image_size=(160, 120), renderer="tiny")
    other.reset(seed=0)
    for camera in ("head", "left_wrist"):
        ours, theirs = drawn.capture(camera), other.capture(camera)
        same = ours.segmentation == theirs.segmentation
        assert same.mean() > 0.99 and set(np.unique(ours.segmentation)) == set(np.unique(theirs.segmentation))
        assert np.median(np.abs(ours.depth - theirs.depth)[same]) < 1e-3
    other.close()


def test_projections_lead_to_the_parts(drawn: AlohaEnv) -> None:
    frame, number = drawn.capture(), drawn.engine.part_names.index("cup")
    u, v, w = frame.projections[number] @ [0.0, 0.0, 0.04, 1.0]
    assert frame.parts[round(v / w), round(u / w)] == number + 1
    assert drawn.segmentation_classes[frame.segmentation[round(v / w), round(u / w)]] == "cup"


def test_skipped_pictures_repeat_the_last(drawn: AlohaEnv) -> None:
    first, _ = drawn.reset(seed=1)
    moved = swing(0)[20]
    blank = drawn.step(moved, render=False)[0]
    np.testing.assert_array_equal(blank["pixels"], first["pixels"])
    assert (drawn.step(moved)[0]["pixels"] != first["pixels"]).any()


def test_the_view_of_a_log_is_the_robot_alone(drawn: AlohaEnv) -> None:
    with RobotView(RobotModel.load("aloha"), CAMERAS["head"], (96, 72), engine="mujoco") as view:
        frame = view.at(swing(0)[0])
    assert set(np.unique(frame.segmentation)) == {0, 2}


def test_without_opengl_states_work_and_pictures_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(choice: str, size: tuple[int, int]) -> Any:
        raise SimulationError("engine 'mujoco' draws pictures by EGL or OSMesa, and neither can be loaded")

    monkeypatch.setattr(rendering, "open_context", absent)
    AlohaEnv(engine="mujoco", obs_type="state").reset(seed=0)
    with pytest.raises(SimulationError, match="EGL or OSMesa"):
        AlohaEnv(engine="mujoco").reset(seed=0)


def test_a_context_that_fails_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)
    with pytest.raises(SimulationError, match=r"neither can be loaded \(osmesa: .*use obs_type='state'"):
        rendering.open_context("osmesa", (64, 48))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"engine": "ode"}, "engine 'ode' is not one of 'auto', 'bullet', 'mujoco'"),
        ({"engine": "mujoco", "renderer": "tiny"}, "renderer 'tiny' is not one of 'auto', 'egl', 'osmesa'"),
    ],
)
def test_what_there_is_not_is_one_sentence(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SimulationError, match=sentence):
        AlohaEnv(obs_type="state", **arguments)


def test_auto_is_pybullet_where_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    from embodiedreamer_gym import engines

    for installed, name in ((True, "bullet"), (False, "mujoco")):
        if installed and not engines.has_pybullet():
            continue
        monkeypatch.setattr(engines, "has_pybullet", lambda found=installed: found)
        assert engine_factory("auto").name == name  # pyright: ignore[reportFunctionMemberAccess]


def test_a_prop_that_spins_fast_does_not_diverge() -> None:
    """An arm without tracking can hit the cup so hard that its explicit gyroscopic torques would grow without limit."""
    env = AlohaEnv("PutCupOnMat", obs_type="state", engine="mujoco")
    env.reset(seed=0)
    cup = env.unwrapped.engine._data.joint("cup")  # type: ignore[attr-defined]
    cup.qpos[2] = 5.0
    cup.qvel[3:] = 300.0, 200.0, -150.0
    for _ in range(90):
        env.step(swing(0)[0])
    assert np.isfinite(cup.qpos).all() and np.abs(cup.qvel).max() <= 100.0
    env.close()
