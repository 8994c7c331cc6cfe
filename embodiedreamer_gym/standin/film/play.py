"""Episodes of the scripted expert, with the state of every control step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.engines.frame import Frame
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.standin.film.geometry import Part, scene_parts
from embodiedreamer_gym.standin.film.settings import STEPS

MARGIN = 15  # control steps kept after the last one with motion
MOTION = 0.002  # rad, m or share of the gripper's opening per control step, above which a joint moves


@dataclass(frozen=True, eq=False)
class ExpertEpisode:
    """States and actions of T control steps.

    side: arm that acts.
    bodies: names of the links and props.
    position: joint positions (T, 14) before each action, in the environment's units.
    action: (T, 14).
    poses: of the bodies in the world (T, bodies, 4, 4), m.
    objects: prop -> position m and quaternion xyzw (T, 7).
    """

    side: str
    bodies: tuple[str, ...]
    position: np.ndarray
    action: np.ndarray
    poses: np.ndarray
    objects: Mapping[str, np.ndarray]

    def __repr__(self) -> str:
        return f"ExpertEpisode({len(self.position)} steps, {self.side})"

    @property
    def active_steps(self) -> int:
        """Number of control steps up to the last motion, plus MARGIN."""
        moving = np.flatnonzero(np.abs(np.diff(self.position, axis=0)).max(axis=1) > MOTION)
        last = int(moving[-1]) + 1 if moving.size else 0
        return min(last + MARGIN, len(self.position))

    def select(self, steps: np.ndarray) -> ExpertEpisode:
        """The episode at these steps only."""
        return ExpertEpisode(self.side, self.bodies, self.position[steps], self.action[steps], self.poses[steps],
                             {name: poses[steps] for name, poses in self.objects.items()})  # fmt: skip


class EpisodePlayer:
    """Plays the scripted expert in an environment of one task; parts: visual shapes of its robot and props."""

    def __init__(self, task: str) -> None:
        self.env = AlohaEnv(task, obs_type="state", renderer="tiny")
        self.parts: list[Part] = scene_parts(self.env.robot.urdf, self.env.task.props)
        self.props = tuple(prop.name for prop in self.env.task.props)
        self.links = tuple(dict.fromkeys(part.body for part in self.parts if part.body not in self.props))

    def play(self, seed: int, steps: int | None = None, watch: Callable[[int], None] | None = None) -> ExpertEpisode:
        """Play an episode; deterministic for a seed.

        steps: number of steps, by default STEPS; watch: called with the number of each step before it is taken.
        """
        self.env.reset(seed=seed)
        expert = ScriptedExpert(self.env)
        rows: list[tuple[np.ndarray, ...]] = []
        for step in range(STEPS if steps is None else steps):
            if watch is not None:
                watch(step)
            position, poses, objects = self._state()
            action = expert.act()
            rows.append((position, action, poses, objects))
            self.env.step(action)
        position, action, poses, objects = (np.array(column) for column in zip(*rows, strict=True))
        by_name = dict(zip(self.props, objects.swapaxes(0, 1), strict=True))
        return ExpertEpisode(self.env.side, (*self.links, *self.props), position, action, poses, by_name)

    def capture(self, camera: Camera, size: tuple[int, int]) -> Frame:
        """The simulator's rendering of the current state for a camera in the world or on a link; size: width, height."""
        return self.env.engine.capture(camera, size)

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def _state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joint positions (14,), poses of the bodies (bodies, 4, 4) and of the props (props, 7)."""
        engine = self.env.engine
        props = [engine.pose(name) for name in self.props]
        bodies = [*(engine.link_pose(name) for name in self.links), *props]
        poses = np.tile(np.eye(4), (len(bodies), 1, 1))
        for matrix, body in zip(poses, bodies, strict=True):
            matrix[:3, :3], matrix[:3, 3] = body.rotation, body.position
        objects = [np.concatenate([prop.position, prop.quaternion]) for prop in props]
        return self.env.joint_positions(), poses, np.array(objects)
