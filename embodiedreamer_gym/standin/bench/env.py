"""The stand-in for a real bench as an environment: another physics engine, hidden effects, a path-traced camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from embodiedreamer_gym.envs import observations as observe
from embodiedreamer_gym.envs.arguments import check_choice, check_size, control_steps
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.envs.tasks.task import Situation, placed
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.standin.bench.pictures import PathTraced
from embodiedreamer_gym.standin.bench.robot import Effects
from embodiedreamer_gym.standin.bench.world import Bench
from embodiedreamer_gym.standin.film.settings import STEPS

Pictures = Callable[[Mapping[str, np.ndarray]], np.ndarray]
PICTURES = ("traced", "none")


class StandInEnv(gym.Env):
    """The real world of a policy that is not to see it before: two arms at a table in MuJoCo, tasks as in AlohaEnv.

    Action (k, 14), k = `chunk` or less: joint targets in AlohaEnv's units, played one after the other at `control_hz`; the
    controller ramps from one to the next. Observation, once, after the last of them: {"pixels": (H, W, 3) uint8 of the
    head camera, "agent_pos": (14,) encoders}. Reward: the sum over the actions of minus the distance of the acting arm's
    end effector to the task's target, m. Info as AlohaEnv's, and `steps`, how many actions were played: less than were
    given where the episode was cut, after 300. Props are drawn as AlohaEnv.reset draws them for the same seed.

    task: a name in TASKS; effects: hidden ones of the robot, see `standin.hidden`; look: lab, or a whole number that
    draws a bench; size: width and height of a picture; seed_of_robot: of its own errors of mass and gain, None for
    none; pictures: traced; none for black ones; or a function of the poses (4, 4) of links and props by name.
    Raises: ModelError, EffectError, SimulationError or VisionError that names what is allowed; MissingExtraError.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        task: str = "PutCupOnMat",
        effects: Effects | None = None,
        chunk: int = 100,
        look: str = "lab",
        size: tuple[int, int] = (128, 96),
        seed_of_robot: int | None = 0,
        pictures: str | Pictures = "traced",
        control_hz: int = 30,
    ) -> None:
        self.task = TASKS[check_choice("task", task, TASKS)]()
        if isinstance(chunk, bool) or not isinstance(chunk, int | np.integer) or chunk < 1:
            raise SimulationError(f"a chunk has 1 or more actions, not {chunk!r}.")
        self.chunk, self.size = int(chunk), check_size("size", size)
        control_steps(control_hz)
        self.control_hz = int(control_hz)
        if not callable(pictures):
            check_choice("pictures", pictures, PICTURES)
        self.bench = Bench(self.task, effects, seed_of_robot, self.control_hz)
        self._traced = PathTraced(self.bench.robot, self.task.props, look, self.size) if pictures == "traced" else None
        self._pictures = pictures if callable(pictures) else None
        self.cameras = ("head",)
        one = observe.action_space(self.bench.robot)
        low, high = (np.repeat(bound[None], self.chunk, axis=0) for bound in (one.low, one.high))
        self.action_space = spaces.Box(low, high, dtype=np.float32)
        self._joint_space = observe.joint_space(self.bench.robot)
        pixels = observe.pixel_space(self.cameras, self.size)
        self.observation_space = spaces.Dict({"pixels": pixels, "agent_pos": self._joint_space})
        self._played: int | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode: props as AlohaEnv places them, arms at rest at home.

        options: object_poses, prop -> position m and quaternion xyzw (7,); the arm on the object's side then acts.
        Raises: SimulationError for another option or what is no pose, MissingExtraError without bpy.
        """
        for key in options or {}:
            check_choice("reset option", key, ("object_poses",))
        super().reset(seed=seed)
        side, poses = self.task.place(self.np_random)
        side, poses = placed(side, poses, (options or {}).get("object_poses"), self.task.object.name)
        self._noise = self.np_random.spawn(1)[0]  # which leaves what is drawn next as it is
        self.bench.reset(side, poses)
        self._played = 0
        return self._observe(), self._info(0)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Play up to `chunk` actions (k, 14), or as many as the episode has left.

        Raises: SimulationError for another shape, or what is not finite, or where the engine diverges.
        """
        if self._played is None or self._played >= STEPS:
            raise gym.error.ResetNeeded("call reset before the first step, and after an episode's end.")
        rows = self._check(action)[: STEPS - self._played]
        reward = 0.0
        for target in rows:
            reward -= self._distance(self.bench.play(target))
        self._played += len(rows)
        return self._observe(), reward, False, self._played >= STEPS, self._info(len(rows))

    def close(self) -> None:
        """End the camera; twice does no harm."""
        if self._traced is not None:
            self._traced.close()

    def _check(self, action: Any) -> np.ndarray:
        """Targets (k, 14) inside the joints' reach."""
        rows = np.asarray(action, float)
        n = self.bench.robot.n
        if rows.ndim != 2 or rows.shape[1] != n or not 1 <= len(rows) <= self.chunk:
            raise SimulationError(f"a chunk has shape (k, {n}) with k from 1 to {self.chunk}, not {rows.shape}.")
        if not np.isfinite(rows).all():
            raise SimulationError("a chunk holds a number that is not finite.")
        return np.clip(rows, self._joint_space.low, self._joint_space.high)

    def _observe(self) -> dict[str, np.ndarray]:
        """What camera and encoders give at this instant."""
        return {"pixels": self._look(), "agent_pos": observe.clipped(self.bench.engine.encoders(), self._joint_space)}

    def _look(self) -> np.ndarray:
        """The head camera's picture (H, W, 3)."""
        if self._traced is not None:
            return self._traced.take(self.bench.poses(), self._noise)
        width, height = self.size
        if self._pictures is None:
            return np.zeros((height, width, 3), np.uint8)
        picture = np.asarray(self._pictures(self.bench.poses()))
        if picture.shape != (height, width, 3) or picture.dtype != np.uint8:
            raise SimulationError(
                f"pictures must give uint8 of shape {(height, width, 3)}, not {picture.dtype} of {picture.shape}."
            )
        return picture

    def _distance(self, now: Situation) -> float:
        """From the end effector to the task's target, m."""
        return float(np.linalg.norm(now.tip.position - self.task.target(now)))

    def _info(self, steps: int) -> dict[str, Any]:
        """What is told beside the reward, as AlohaEnv does."""
        now, seconds = self.bench.situation(), (self._played or 0) / self.control_hz
        return self.bench.attempt.info(now, self.task.target(now), seconds) | {"steps": steps}
