"""The robot, a table and a task's props in MuJoCo, and what a task may judge by."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from embodiedreamer_gym.engines.mujoco.furniture import Furniture
from embodiedreamer_gym.engines.table import TABLE
from embodiedreamer_gym.envs.robots import home
from embodiedreamer_gym.envs.tasks import Task
from embodiedreamer_gym.envs.tasks.attempt import Attempt
from embodiedreamer_gym.envs.tasks.task import SIDES, Situation
from embodiedreamer_gym.geometry.pose import Pose
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.bench.robot import Effects, build_robot, load_nominal

LONGEST_STEP = 5e-4  # s, of the engine


class Bench:
    """A task's props and the robot; it plays commands a control period at a time.

    home (n,): the command at which its arms rest when an episode starts.
    Raises: EffectError for effects that the robot cannot have, MissingExtraError without MuJoCo.
    """

    def __init__(self, task: Task, effects: Effects | None, seed_of_robot: int | None, control_hz: int) -> None:
        self.task, self.robot = task, load_nominal()
        self.home = home(self.robot)
        self._period = 1.0 / control_hz
        self._steps = int(np.ceil(self._period / LONGEST_STEP - 1e-9))
        fingers = _finger_joints(self.robot)
        furniture = Furniture(task.props, [joint for joints in fingers for joint in joints])
        self.engine = build_robot(effects, seed_of_robot, self._period / self._steps, furniture).engine
        self._model, self._data = self.engine.model, self.engine.data
        self._fingers = [[self._link(joint) for joint in joints] for joints in fingers]
        tree = self.robot.tree
        roots = [np.flatnonzero(tree.arm[tree.coordinate] == arm)[0] for arm in range(tree.arms)]
        self._bases = [np.array(tree.origin[root]) for root in roots]
        self._commands: list[np.ndarray] = []

    def reset(self, side: str, poses: Mapping[str, Pose]) -> None:
        """Start an episode: arms at rest at home, props in place.

        Raises: SimulationError when the arms do not come to rest at home.
        """
        self._commands = [self.home]
        self.engine.begin(self.home)
        for prop in self.task.props:
            body, pose = self._model.body(prop.name), poses[prop.name]
            where = np.concatenate([pose.position, np.roll(pose.quaternion, 1)])
            if prop.fixed:
                body.pos, body.quat = where[:3], where[3:]
            else:
                self._data.joint(prop.name).qpos = where
        self.engine.refresh()
        self._side, self._start, self.attempt = side, poses[self.task.object.name], Attempt(self.task)
        self.attempt.see(self.situation())

    def play(self, target: np.ndarray) -> Situation:
        """Ramp to joint targets (n,) within one control period, as the controller does; what the world is then.

        Raises: SimulationError when the engine diverges.
        """
        self._commands.append(target)
        commands = np.array(self._commands)
        times = np.arange(len(commands)) * self._period
        self.engine.advance(lambda t: np.stack([np.interp(t, times, one) for one in commands.T], axis=1), self._steps)
        now = self.situation()
        self.attempt.see(now)
        return now

    def pose(self, name: str) -> Pose:
        """Where the frame of a link or prop is."""
        body = self._data.body(name)
        return Pose(body.xpos.copy(), np.roll(body.xquat, -1))

    def poses(self) -> dict[str, np.ndarray]:
        """Where the frames (4, 4) of links, table and props are, by name."""
        found = {}
        for i in range(1, self._model.nbody):  # 0 is the world
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self._data.xmat[i].reshape(3, 3), self._data.xpos[i]
            found[self._model.body(i).name] = pose
        return found

    def situation(self) -> Situation:
        """The world at this instant, as the task judges it."""
        task, arm = self.task, SIDES.index(self._side)
        thing, goal = task.object, task.goal or task.object
        touched = self._touching(thing.name)
        return Situation(
            side=self._side, base=self._bases[arm].copy(), tip=self.pose(self.robot.arms[arm]),
            object=self.pose(thing.name), goal=self.pose(goal.name), start=self._start, speed=self._speed(thing.name),
            fingers=sum(finger in touched for finger in self._fingers[arm]), on_goal=goal.name in touched,
            on_table=TABLE.name in touched, grasped=self.attempt.grasped,
        )  # fmt: skip

    def _link(self, joint: str) -> str:
        """Name of the link that a joint moves."""
        return self._model.body(int(self._model.joint(joint).bodyid[0])).name

    def _touching(self, name: str) -> set[str]:
        """Names of the bodies that a prop touches."""
        model, body = self._model, self._model.body(name).id
        pairs = model.geom_bodyid[self._data.contact.geom]
        found = pairs[(pairs == body).any(axis=1)]
        return {model.body(int(other)).name for other in np.unique(found[found != body])}

    def _speed(self, name: str) -> float:
        """Speed of a prop's centre of mass, m/s."""
        velocity = self._data.joint(name).qvel
        body = self._data.body(name)
        arm = body.xipos - body.xpos
        spin = body.xmat.reshape(3, 3) @ velocity[3:]
        return float(np.linalg.norm(velocity[:3] + np.cross(spin, arm)))


def _finger_joints(robot: RobotModel) -> list[list[str]]:
    """Of each arm, the joints that its gripper moves."""
    tree = robot.tree
    moved = [b for b in range(tree.bodies) if tree.prismatic[b]]
    return [
        [tree.joint_names[b] for b in moved if tree.arm[tree.coordinate[b]] == arm] for arm in range(len(robot.arms))
    ]
