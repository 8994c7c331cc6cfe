"""What a user may hand to an environment, and the one sentence for anything else."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.engines.engine import STEPS_PER_SECOND
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.arguments import check_control_rate, check_flag
from embodiedreamer_gym.envs.cameras import CAMERAS, save_cameras
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.robot import RobotModel

ID = "EmbodieDreamer/PutCupOnMat-v0"
WRONG = [
    ({"task": "Fly"}, "task 'Fly' is not one of .*'PutCupOnMat'"),
    ({"obs_type": "rgb"}, "obs_type 'rgb' is not one of 'state', 'pixels', 'pixels_agent_pos'"),
    ({"cameras": ("head", "nose")}, "camera 'nose' is not one of 'head', 'left_wrist', 'right_wrist'"),
    ({"cameras": ()}, r"camera \(\) is not one of 'head'"),
    ({"cameras": ("head", "head")}, r"camera names must differ, not \['head', 'head'\]"),
    ({"cameras": 3}, "camera 3 is not one of 'head'"),
    ({"cameras": "nose"}, "camera 'nose' is not one of 'head'"),
    ({"control_hz": 60}, "control_hz 60 is not one of 50, 40, 30, 20"),
    ({"control_hz": "30"}, "control_hz '30' is not one of"),
    ({"control_hz": [30]}, r"control_hz \[30\] is not one of"),
    ({"image_size": (640,)}, "not a width and height from 8 to 4096"),
    ({"image_size": (4, 4)}, "not a width and height from 8 to 4096"),
    ({"image_size": (64.5, 64)}, "not a width and height from 8 to 4096"),
    ({"image_size": "88"}, "not a width and height from 8 to 4096"),
    ({"renderer": "vulkan"}, "renderer 'vulkan' is not one of 'auto', 'tiny', 'egl'"),
    ({"randomize": "all"}, "randomize 'all' is not one of None, 'calibration'"),
    ({"robot": "nobody"}, r"nobody is neither a file nor a built-in robot \(aloha, servo, so101\)"),
    ({"robot": "so101"}, "so101 has 6 joints on 1 arms; the ALOHA environments need 14: 6 and a normalised gripper"),
    ({"robot": 3}, "a built-in robot's name or a model file's path, not a int"),
    ({"camera_file": 0.5}, "a camera file must be given as a path, not as 0.5"),
    ({"engine": np.zeros(2)}, "engine array.* is not one of 'auto', 'bullet', 'mujoco'"),
    ({"renderer": 3}, "renderer 3 is not one of"),
    ({"camera_file": "none.json"}, "camera file none.json cannot be read: No such file"),
]


def sentence(error: pytest.ExceptionInfo) -> str:
    """Its text, which has to be one sentence of one line."""
    text = str(error.value)
    assert "\n" not in text and text.endswith(".") and isinstance(error.value, ValueError)
    return text


@pytest.mark.parametrize(("arguments", "says"), WRONG, ids=[str(arguments) for arguments, _ in WRONG])
def test_what_is_not_allowed_is_told_with_what_is(arguments: dict, says: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=says) as error:
        gym.make(ID, **arguments)
    sentence(error)


@pytest.mark.filterwarnings("ignore:.*render_mode='ansi'")
def test_another_render_mode_is_refused() -> None:
    with pytest.raises(EmbodieDreamerError, match="render_mode 'ansi' is not one of None, 'rgb_array'"):
        gym.make(ID, render_mode="ansi")


def test_a_goal_environment_observes_states_only() -> None:
    with pytest.raises(EmbodieDreamerError, match="'pixels' is not one of 'state'") as error:
        gym.make("EmbodieDreamer/PutCupOnMatGoal-v0", obs_type="pixels")
    sentence(error)


def test_a_robot_whose_grippers_come_first_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "swapped.json"
    RobotModel.load("aloha").save(path)
    data = json.loads(path.read_text())
    joints = data["robot"]["joints"]
    data["robot"]["joints"] = [*joints[6::-1], *joints[:6:-1]]
    path.write_text(json.dumps(data))
    with pytest.raises(
        EmbodieDreamerError, match="has 14 joints on 2 arms; the ALOHA environments need 14: 6 and"
    ) as error:
        AlohaEnv(robot=str(path), obs_type="state")
    sentence(error)


def test_a_camera_on_a_link_that_the_robot_has_not_is_refused(tmp_path: Path) -> None:
    save_cameras([CAMERAS["head"].with_(link="forehead")], tmp_path / "c.json")
    with pytest.raises(EmbodieDreamerError, match=r"link of camera head 'forehead' is not one of .*'left_link6'"):
        AlohaEnv(camera_file=str(tmp_path / "c.json"))


def test_cameras_of_a_file_are_those_that_see(tmp_path: Path) -> None:
    save_cameras([CAMERAS["head"].with_(name="mast"), CAMERAS["left_wrist"]], tmp_path / "c.json")
    env = AlohaEnv(camera_file=str(tmp_path / "c.json"), cameras="mast", image_size=(64, 48), render_mode="rgb_array")
    head = AlohaEnv(image_size=(64, 48), renderer="tiny")
    seen, other = env.reset(seed=0)[0], head.reset(seed=0)[0]
    np.testing.assert_array_equal(seen["pixels"], other["pixels"])
    assert env.render().shape == (480, 640, 3)
    with pytest.raises(EmbodieDreamerError, match="camera 'head' is not one of 'mast', 'left_wrist'"):
        AlohaEnv(camera_file=str(tmp_path / "c.json"))
    env.close(), head.close()


# ---- in an episode ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def env():
    made = AlohaEnv(obs_type="state")
    made.reset(seed=0)
    yield made
    made.close()


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (np.zeros(13), r"action needs 14 numbers, shape \(14,\), not shape \(13,\)"),
        (np.zeros((1, 14)), r"not shape \(1, 14\)"),
        (np.full(14, np.nan), "action contains a number that is not finite"),
        (np.full(14, np.inf), "action contains a number that is not finite"),
        ("move", "action needs 14 real numbers, not 'move'"),
        (["0.1"] * 14, "action needs 14 real numbers, not .'0.1', "),
        (np.zeros(14, complex), "action needs 14 real numbers, not array"),
        ([10**400] * 14, "action needs 14 real numbers, not .1000"),
        ([10**9999] * 14, "action needs 14 real numbers, not a list"),
        ([[0.0], [0.0, 1.0]], "action needs 14 real numbers"),
        (None, "action needs 14 real numbers, not None"),
    ],
)
def test_another_action_is_refused_and_changes_nothing(env: AlohaEnv, action, says: str) -> None:
    before = env.joint_positions()
    with pytest.raises(EmbodieDreamerError, match=says) as error:
        env.step(action)
    sentence(error)
    np.testing.assert_array_equal(env.joint_positions(), before)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"pose": 1}, "reset option 'pose' is not one of 'joint_positions', 'joint_velocities', 'command'"),
        ({"joint_positions": [0.0]}, "joint_positions needs 14 numbers"),
        ({"command": [np.nan] * 14}, "command contains a number that is not finite"),
        ({"joint_positions": np.full(14, 9.0)}, r"joint_positions\[0\] is 9, not within -3.118 .. 3.118"),
        ({"joint_velocities": np.full(14, 1e3)}, r"joint_velocities\[0\] is 1000, not within -100 .. 100"),
    ],
)
def test_another_start_is_refused_and_changes_nothing(env: AlohaEnv, options: dict, says: str) -> None:
    before, drawn = env.joint_positions(), env.np_random.bit_generator.state
    with pytest.raises(EmbodieDreamerError, match=says) as error:
        env.reset(seed=5, options=options)
    sentence(error)
    np.testing.assert_array_equal(env.joint_positions(), before)
    assert env.np_random.bit_generator.state == drawn


@pytest.mark.parametrize(
    ("poses", "says"),
    [(5, "object_poses must be a dictionary, not 5"), ({"sun": [0] * 7}, "prop 'sun' is not one of"),
     ({"cup": ["0"] * 7}, "pose of cup needs 7 real numbers"),
     ({"cup": [0.0] * 7}, "pose of cup: the last four numbers are not a unit quaternion")],
)  # fmt: skip
def test_another_pose_of_an_object_is_refused(env: AlohaEnv, poses, says: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=says) as error:
        env.reset(seed=0, options={"object_poses": poses})
    sentence(error)


def test_bad_options_draw_nothing(env: AlohaEnv) -> None:
    drawn = env.np_random.bit_generator.state
    for options in (5, {5: 0}, {"object_poses": 5}, {"object_poses": {"cup": [0.0] * 7}}):
        with pytest.raises(EmbodieDreamerError):
            env.reset(seed=5, options=options)
    assert env.np_random.bit_generator.state == drawn


def test_nothing_is_observed_before_the_first_reset() -> None:
    env = AlohaEnv(obs_type="state", render_mode="rgb_array")
    for call in (
        env.observe,
        env.situation,
        env.joint_positions,
        env.joint_velocities,
        env.render,
        lambda: env.object_pose("cup"),
        lambda: env.side,
    ):
        with pytest.raises(gym.error.ResetNeeded, match="call reset"):
            call()
    env.close()
    with pytest.raises(gym.error.ClosedEnvironmentError, match="closed"):
        env.capture()


@pytest.mark.parametrize("value", ["no", 0, 1.0, None, 10**9999], ids=["text", "0", "1.0", "None", "huge"])
def test_a_flag_is_true_or_false(value) -> None:
    assert check_flag("collisions", True) is True and check_flag("collisions", np.False_) is False
    with pytest.raises(EmbodieDreamerError, match=r"collisions .* is neither True nor False"):
        check_flag("collisions", value)


def test_it_starts_as_the_options_say() -> None:
    env = AlohaEnv(obs_type="state")
    start = np.array([0.2, 1.0, -1.0, 0.1, 0.3, -0.2, 0.4] * 2)
    state, _ = env.reset(seed=0, options={"joint_positions": start, "joint_velocities": 0.1 * start})
    np.testing.assert_allclose(state[:28], [*start, *0.1 * start], rtol=1e-5)
    free, _ = env.reset(seed=0)
    np.testing.assert_array_equal(free[34:], env.reset(seed=0, options={"joint_positions": start})[0][34:])
    env.close()


def test_a_step_before_the_first_reset_is_refused() -> None:
    env = AlohaEnv(obs_type="state")
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(14))
    env.close()


def test_actions_far_beyond_the_limits_are_cut_and_end_stops_hold() -> None:
    one, two = (AlohaEnv(obs_type="state") for _ in range(2))
    one.reset(seed=0), two.reset(seed=0)
    for _ in range(20):
        far, near = one.step(np.full(14, 50.0)), two.step(two.action_space.high + 0.5)
        np.testing.assert_array_equal(far[0], near[0])
    assert (one.joint_positions() < one.action_space.high + 0.1).all()
    one.close(), two.close()


# ---- the clock -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hz", STEPS_PER_SECOND)
def test_physics_steps_divide_each_control_period(hz: int) -> None:
    env = AlohaEnv(obs_type="state", control_hz=hz)
    env.reset(seed=0)
    count, plant = 0, env.engine.plant.step

    def step(command):
        nonlocal count
        count += 1
        return plant(command)

    env.engine.plant.step = step
    hold = env.joint_positions()
    times = [env.step(hold)[-1]["sim_time"] for _ in range(hz)]
    assert times[-1] == 1.0 and np.allclose(np.diff(times), 1 / hz)
    assert count * env.engine.plant.dt == pytest.approx(1.0, abs=1e-12) and count == STEPS_PER_SECOND[hz]
    assert env.engine.plant.drive.time == pytest.approx(1.0)
    assert env.metadata["render_fps"] == env.control_hz == hz
    env.close()


@pytest.mark.parametrize("hz", [30, 30.0, np.int64(30), np.float64(30)])
def test_a_rate_may_be_any_number(hz) -> None:
    assert check_control_rate(hz) == 30


@pytest.mark.parametrize("rule", ["linear", "unknown", "hold"])
def test_what_an_action_means_is_what_the_robot_says(rule: str, tmp_path: Path) -> None:
    """Commands that the servos hear: a ramp from the last action to this one, or this one at once."""
    path = tmp_path / "robot.json"
    RobotModel.load("aloha").with_(command_hold=rule).save(path)
    env = AlohaEnv(obs_type="state", robot=str(path))
    env.reset(seed=0)
    heard, plant = [], env.engine.plant.step
    env.engine.plant.step = lambda command: (heard.append(command[0]), plant(command))[1]
    for target in (0.08, 0.16):
        action = env.joint_positions()
        action[0] = target
        env.step(action)
    wanted = {False: np.arange(16) * 0.01, True: [0.04, *[0.08] * 7, 0.12, *[0.16] * 7]}[rule == "hold"]
    np.testing.assert_allclose(heard, wanted, atol=1e-7)
    assert env.metadata["command_hold"] == rule
    env.close()
