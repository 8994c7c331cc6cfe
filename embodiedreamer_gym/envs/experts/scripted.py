"""One recipe for all tasks: reach, close, lift, carry, lower, open, retreat."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium as gym
import numpy as np

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts.plan import Paths, Planner
from embodiedreamer_gym.envs.tasks.task import SIDES
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.robot.kinematics import RADIUS, Kinematics, rotation_vector
from embodiedreamer_gym.robot.paths import Path

CLOSING, OPENING = 0.5, 0.4  # s
PATIENCE = 0.8  # s: longest wait for the arm to come to rest
NEAR = 1.5e-3  # m: largest error of the end effector at rest
GAIN = 2.5  # 1/s at which measured errors are integrated into the command
DAMPING = 0.02  # m, of the least squares that convert errors of the end effector to angles
MOST = 0.4  # rad: largest correction

Order = tuple[np.ndarray, np.ndarray, float]  # angles (m,) rad, their speeds, the gripper's opening


class ScriptedExpert:
    """Plays one episode of an ALOHA environment's task; make one after each reset.

    It uses the poses of arm and props, plans with the robot's kinematics, and commands joint targets. Because the
    servos sag and lag, its commands lead by the robot model's damping over stiffness, and it integrates the end
    effector's error.
    Raises: SimulationError for another environment.
    """

    def __init__(self, env: gym.Env) -> None:
        aloha = env.unwrapped
        if not isinstance(aloha, AlohaEnv):
            raise SimulationError(
                f"{env} is not an ALOHA environment, the only kind that the scripted expert can play."
            )
        robot, side = aloha.robot, SIDES.index(aloha.side)
        self._env = aloha
        self._arm = Kinematics(robot, robot.arms[side])
        self._plan = Planner(self._arm, aloha.task)
        own = np.flatnonzero(robot.tree.arm == robot.tree.arm[self._arm.joints[0]])
        self._gripper = next(int(j) for j in own if robot.units[j] == "1")
        self._action = np.clip(aloha.command, aloha.action_space.low, aloha.action_space.high)
        lag = (robot.damping + robot.viscous_friction) / robot.stiffness
        self._lag = lag[self._arm.joints]
        self._angles = aloha.joint_positions()[self._arm.joints]
        self._trim = self._action[self._arm.joints] - self._angles  # how far they are below their command at the start
        self._script = self._recipe()

    def act(self) -> np.ndarray:
        """The next action (14,); the other arm does not move."""
        self._correct()
        angles, speed, opening = next(self._script)
        self._angles = angles
        self._action[self._arm.joints] = angles + self._lag * speed + self._trim
        self._action[self._gripper] = opening
        space = self._env.action_space
        return np.clip(self._action, space.low, space.high).astype(space.dtype)

    # ---- what it does ------------------------------------------------------------------------------------------

    def _recipe(self) -> Iterator[Order]:
        """Orders of the whole episode, one for each control period; at the end the arm holds its position."""
        task, opening = self._env.task, self._env.task.opening
        pick = self._plan.pick(self._env.situation(), self._angles)
        while pick is not None:
            yield from self._take(pick, opening)
            if self._held() and task.goal is None:
                yield from self._hold(0.0)
            place = self._plan.place(self._env.situation(), self._angles) if self._held() else None
            if place is not None:
                yield from self._follow(place[0], 0.0)
            if place is not None and self._held():
                yield from self._give(place, opening)
                yield from self._hold(opening)
            yield from self._wait(OPENING, opening)
            pick = self._plan.pick(self._env.situation(), self._angles)  # it has slipped: try again
        yield from self._hold(opening)

    def _take(self, pick: Paths, opening: float) -> Iterator[Order]:
        """Reach, close, lift."""
        yield from self._follow(pick[0], opening)
        yield from self._follow(pick[1], opening)
        yield from self._rest(opening)
        yield from self._wait(CLOSING, 0.0)
        yield from self._follow(pick[2], 0.0)

    def _give(self, place: Paths, opening: float) -> Iterator[Order]:
        """Lower, open, retreat."""
        yield from self._rest(0.0)
        yield from self._follow(place[1], 0.0)
        yield from self._rest(0.0)
        yield from self._wait(OPENING, opening)
        yield from self._follow(place[2], opening)

    def _held(self) -> bool:
        """Whether both fingers touch the object."""
        return self._env.situation().fingers == 2

    def _follow(self, path: Path, opening: float) -> Iterator[Order]:
        """Follow a path."""
        for time in np.arange(1.0, np.ceil(path.seconds * self._env.control_hz) + 1.0) / self._env.control_hz:
            yield (*path.at(time), opening)

    def _wait(self, seconds: float, opening: float) -> Iterator[Order]:
        """Hold the position while the gripper moves."""
        for _ in range(round(seconds * self._env.control_hz)):
            yield self._angles, np.zeros_like(self._angles), opening

    def _rest(self, opening: float) -> Iterator[Order]:
        """Hold the position until the end effector has reached it."""
        for order in self._wait(PATIENCE, opening):
            if np.abs(self._error()).max() < NEAR:
                return
            yield order

    def _hold(self, opening: float) -> Iterator[Order]:
        """Hold the position forever."""
        while True:
            yield self._angles, np.zeros_like(self._angles), opening

    # ---- how it stays on course --------------------------------------------------------------------------------

    def _error(self) -> np.ndarray:
        """Error (6,) of the end effector's pose: position in m, and rotation in rad times `RADIUS`."""
        tip = self._env.situation().tip
        position, rotation = self._arm.pose(self._angles)
        turn = rotation_vector(rotation @ tip.rotation.T)
        return np.concatenate([position - tip.position, RADIUS * turn])

    def _correct(self) -> None:
        """Integrate that error into a correction of the joint angles."""
        jacobian = self._arm.jacobian(self._angles)
        jacobian[3:] *= RADIUS
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING**2 * np.eye(6), self._error())
        self._trim = np.clip(self._trim + GAIN / self._env.control_hz * step, -MOST, MOST)
