"""The ALOHA environment: one class for all tasks."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle

from embodiedreamer_gym.engines import Engine, EngineFactory, EngineSettings, engine_factory
from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.engines.table import TABLE
from embodiedreamer_gym.envs import observations as observe
from embodiedreamer_gym.envs.arguments import (
    check_choice,
    check_control_rate,
    check_flag,
    check_mapping,
    check_size,
    choose,
    vector,
)
from embodiedreamer_gym.envs.cameras import CAMERAS, load_cameras
from embodiedreamer_gym.envs.reset_options import beginning
from embodiedreamer_gym.envs.robots import draw_parameters, home, load_robot
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.envs.tasks.attempt import Attempt
from embodiedreamer_gym.envs.tasks.task import SIDES, Situation, placed
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.geometry.pose import Pose

RENDER_SIZE = (640, 480)


class AlohaEnv(gym.Env, EzPickle):
    """Two six-joint arms with grippers at a table, run by a calibrated robot model.

    Action (14,): joint targets, left arm's six (rad) and gripper (0 closed .. 1 open), then the right arm's.
    Between two actions the controller ramps to the action (`linear`) or holds it (`hold`), as the robot model says.
    Reward: minus the distance of the acting arm's end effector to the task's target, m.
    An episode never ends by itself; `gym.make` truncates it after 300 steps.

    task: a name in TASKS.
    robot: a built-in robot or a model file.
    obs_type: state, pixels or pixels_agent_pos.
    cameras: names of cameras, from the file `camera_file` if given.
    image_size: width, height, pixels.
    control_hz: 50, 40, 30 or 20.
    renderer: auto, or tiny or egl of PyBullet, egl or osmesa of MuJoCo.
    randomize: None, or "calibration" to draw the robot's parameters from its calibration's intervals at each reset.
    collisions: False lets the arms pass through everything, to replay logs of free motion.
    engine: auto (PyBullet if it is installed, else MuJoCo), bullet, mujoco, or a factory that takes `EngineSettings`.
    Raises: ModelError, SimulationError or ValueError that names what is allowed.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}

    def __init__(
        self,
        task: str = "PutCupOnMat",
        robot: str = "aloha",
        obs_type: str = "pixels_agent_pos",
        cameras: tuple[str, ...] = ("head",),
        camera_file: str | None = None,
        image_size: tuple[int, int] = (128, 96),
        control_hz: int = 30,
        renderer: str = "auto",
        randomize: str | None = None,
        render_mode: str | None = None,
        collisions: bool = True,
        engine: str | EngineFactory = "auto",
    ) -> None:
        EzPickle.__init__(self, task, robot, obs_type, cameras, camera_file, image_size, control_hz, renderer,
                          randomize, render_mode, collisions, engine)  # fmt: skip
        self.task = TASKS[check_choice("task", task, TASKS)]()
        self.obs_type = check_choice("obs_type", obs_type, observe.OBS_TYPES)
        self.randomize = check_choice("randomize", randomize, (None, "calibration"))
        self.render_mode = check_choice("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        self.image_size = check_size("image_size", image_size)
        self.control_hz = check_control_rate(control_hz)
        known = CAMERAS if camera_file is None else load_cameras(camera_file)
        self.cameras = choose("camera", cameras, known)
        self._render_camera = known["head"] if "head" in known else next(iter(known.values()))
        self.robot = load_robot(robot)
        if self.randomize and not self.robot.intervals:
            raise ModelError(
                f"randomize='calibration' needs a robot with a calibration's intervals, and {robot} has none; "
                "calibrate it first, or use randomize=None."
            )
        pictures = RENDER_SIZE if obs_type == "state" and render_mode else self.image_size
        self.engine: Engine = engine_factory(engine)(
            EngineSettings(self.robot, self.task.props, self.control_hz, check_flag("collisions", collisions),
                           renderer, pictures)
        )  # fmt: skip
        for camera in (*self.cameras.values(), self._render_camera):
            check_choice(f"link of camera {camera.name}", camera.link, (None, *self.engine.links()))
        self.metadata = {**self.metadata, "render_fps": self.control_hz, "engine": self.engine.name,
                         "renderer": self.engine.renderer_name, "light": self.engine.light,
                         "command_hold": self.robot.command_hold}  # fmt: skip
        self.action_space: spaces.Box = observe.action_space(self.robot)  # pyright: ignore[reportIncompatibleVariableOverride]
        self._joint_space = observe.joint_space(self.robot)
        self._state_space = observe.state_space(self.robot)
        self.observation_space = self._space()
        self._pictures: dict[str, np.ndarray] = {}
        self._command: np.ndarray | None = None
        self._rest: np.ndarray | None = None  # joint positions (14,)
        self._closed = False

    # ---- gymnasium ---------------------------------------------------------------------------------------------

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode: props at random, arms at rest under the command `home`, or as the options say.

        options: joint_positions (14,) that the encoders read, joint_velocities (14,), command (14,) before the first
        action; units of the action. object_poses: prop -> position m and quaternion xyzw (7,); the arm on the object's
        side then acts.
        Raises: ValueError for an unknown option, or one of another shape or beyond what the joints can do;
        SimulationError if the robot model diverges.
        """
        self._check_open()
        options = dict(check_mapping("options", options))
        given = beginning(options, self.robot, self.task, self._joint_space)
        super().reset(seed=seed)
        self._side, poses = self.task.place(self.np_random)
        self._side, poses = placed(self._side, poses, options.get("object_poses"), self.task.object.name)
        sets = draw_parameters(self.robot, self.np_random) if self.randomize else None
        position, velocity, command = self._at_rest() if given is None else given
        if options:  # PyBullet keeps contacts of arms that start touching the table: move them away first
            self.engine.reset(*self._at_rest(), poses)
        self.engine.reset(position, velocity, command, poses, sets, self.np_random)
        self._command = command
        self._start = poses[self.task.object.name]
        self._attempt = Attempt(self.task)
        self._steps = 0
        return self._observe(render=True)

    def step(self, action: np.ndarray, *, render: bool = True) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive the joints to their targets (14,) for one control period.

        render: False skips rendering; the observation repeats the last pictures.
        Raises: ValueError for an action of another shape, or one that is not finite.
        """
        self._check_started()
        target = vector("action", action, self.robot.n)
        target = np.minimum(np.maximum(target, self._joint_space.low), self._joint_space.high)
        self.engine.advance(target)
        self._command = target
        self._steps += 1
        observation, info = self._observe(render)
        return observation, -info["distance"], False, False, info

    def render(self) -> np.ndarray | None:
        """The head camera's picture (480, 640, 3).

        Raises: ResetNeeded before the first episode.
        """
        if self.render_mode is None:
            return None
        self._check_started()
        return self.engine.rgb(self._render_camera, RENDER_SIZE)

    def close(self) -> None:
        """Close the physics engine; it may be called twice."""
        self._closed = True
        self.engine.close()

    # ---- for data sets and experts -----------------------------------------------------------------------------

    @property
    def task_description(self) -> str:
        """The task in words, for language-conditioned policies."""
        return self.task.description

    @property
    def side(self) -> str:
        """The arm that acts in this episode: left or right. Raises: ResetNeeded before the first episode."""
        self._check_reset()
        return self._side

    @property
    def command(self) -> np.ndarray:
        """The last joint targets (14,) that the controller received; the arms hang slightly lower under their weight.

        Raises: ResetNeeded before the first episode.
        """
        return self._check_reset().copy()

    @property
    def segmentation_classes(self) -> tuple[str, ...]:
        """Names of the classes, by their number in a segmentation."""
        return self.engine.class_names

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of the state vector."""
        return observe.state_names(self.robot)

    def capture(self, camera: str = "head", size: tuple[int, int] | None = None) -> Frame:
        """Colour (H, W, 3), depth (H, W) m and class numbers (H, W) of one camera; size: width, height.

        Raises: ValueError for an unknown camera.
        """
        self._check_open()
        known = {**CAMERAS, **self.cameras}
        size = self.image_size if size is None else check_size("size", size)
        return self.engine.capture(known[check_choice("camera", camera, known)], size)

    def observe(self) -> Any:
        """The current observation, as returned by the last `reset` or `step`, with new pictures."""
        self._check_started()
        return self._observe(render=True)[0]

    def joint_positions(self) -> np.ndarray:
        """Current encoder readings (14,), in the units of the action."""
        self._check_started()
        return self.engine.joints()[0]

    def joint_velocities(self) -> np.ndarray:
        """Current speeds of the joints (14,), in the units of the action per second."""
        self._check_started()
        return self.engine.joints()[1]

    def object_pose(self, prop: str) -> Pose:
        """Current pose of a prop of the task."""
        self._check_started()
        return self.engine.pose(check_choice("prop", prop, [one.name for one in self.task.props]))

    def situation(self) -> Situation:
        """The current state of the world, from which the task is judged."""
        self._check_started()
        engine, task, arm = self.engine, self.task, SIDES.index(self._side)
        thing, goal = task.object.name, (task.goal or task.object).name
        touched = engine.touching(thing)
        return Situation(
            side=self._side, base=engine.bases[arm].copy(), tip=engine.tip(arm), object=engine.pose(thing),
            goal=engine.pose(goal), start=self._start, speed=engine.speed(thing),
            fingers=sum(finger in touched for finger in engine.fingers[arm]), on_goal=goal in touched,
            on_table=TABLE.name in touched, grasped=self._attempt.grasped,
        )  # fmt: skip

    # ---- inside ------------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if self._closed:
            raise gym.error.ClosedEnvironmentError("the environment is closed; make a new one.")

    def _check_started(self) -> None:
        self._check_open()
        self._check_reset()

    def _check_reset(self) -> np.ndarray:
        if self._command is None:
            raise gym.error.ResetNeeded("call reset before the first step.")
        return self._command

    def _at_rest(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joint positions, joint velocities and command (14,) of arms that rest at home.

        Found once, for the robot model as given; a model drawn from its intervals starts within milliradians of rest.
        """
        rest = home(self.robot)
        if self._rest is None:
            self._rest = self.engine.settle(rest)
        return self._rest, np.zeros_like(rest), rest

    def _space(self) -> spaces.Space:
        """The observation space of this obs_type."""
        if self.obs_type == "state":
            return self._state_space
        pixels = observe.pixel_space(tuple(self.cameras), self.image_size)
        if self.obs_type == "pixels":
            return pixels
        return spaces.Dict({"pixels": pixels, "agent_pos": self._joint_space})

    def _observe(self, render: bool) -> tuple[Any, dict[str, Any]]:
        """Current observation and info."""
        position, velocity = self.engine.joints()
        now = self.situation()
        self._attempt.see(now)
        target = self.task.target(now)
        info = self._attempt.info(now, target, self._steps / self.control_hz)
        if self.obs_type != "state" and (render or not self._pictures):
            self._pictures = {name: self.engine.rgb(camera, self.image_size) for name, camera in self.cameras.items()}
        return self._assemble(position, velocity, now, target), info

    def _assemble(self, position: np.ndarray, velocity: np.ndarray, now: Situation, target: np.ndarray) -> Any:
        """The observation of this obs_type."""
        if self.obs_type == "state":
            tips = [(now.tip if side == now.side else self.engine.tip(arm)).position for arm, side in enumerate(SIDES)]
            return observe.clipped(observe.state_vector(position, velocity, tips, now, target), self._state_space)
        pictures = {name: picture.copy() for name, picture in self._pictures.items()}  # observations share no array
        pixels = pictures if len(pictures) > 1 else next(iter(pictures.values()))
        if self.obs_type == "pixels":
            return pixels
        return {"pixels": pixels, "agent_pos": observe.clipped(position, self._joint_space)}
