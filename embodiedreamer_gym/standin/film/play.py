"""The scripted expert plays an episode, and every control step is written down."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.cameras import Frame
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.standin.film.geometry import Part, scene_parts
from embodiedreamer_gym.standin.film.settings import STEPS

STILL = 15  # control steps that are kept after the last in which something moves
MOVES = 0.002  # rad, m or share of the gripper's opening per control step


@dataclass(frozen=True, eq=False)
class Played:
    """An episode by control steps: what the robot did and what the simulator drew.

    position, action (T, 14): as the environment gives and takes them, the action that follows the state; poses (T,
    bodies, 4, 4) of the links and props that `bodies` names; objects: prop -> (T, 7) position m and quaternion xyzw.
    """

    side: str
    bodies: tuple[str, ...]
    position: np.ndarray
    action: np.ndarray
    poses: np.ndarray
    objects: Mapping[str, np.ndarray]

    def __repr__(self) -> str:
        return f"Played({len(self.position)} steps, {self.side})"

    @property
    def busy(self) -> int:
        """Number of control steps until nothing moves any more, and a little longer."""
        moving = np.flatnonzero(np.abs(np.diff(self.position, axis=0)).max(axis=1) > MOVES)
        last = int(moving[-1]) + 1 if moving.size else 0
        return min(last + STILL, len(self.position))

    def only(self, steps: np.ndarray) -> Played:
        """These steps alone."""
        return Played(self.side, self.bodies, self.position[steps], self.action[steps], self.poses[steps],
                      {name: poses[steps] for name, poses in self.objects.items()})  # fmt: skip


class Stage:
    """An environment for one task, and what stands on it."""

    def __init__(self, task: str) -> None:
        self.env = AlohaEnv(task, obs_type="state", renderer="tiny")
        self.parts: list[Part] = scene_parts(self.env.robot.urdf, self.env.task.props)
        self.props = tuple(prop.name for prop in self.env.task.props)
        self.links = tuple(dict.fromkeys(part.body for part in self.parts if part.body not in self.props))

    def play(self, seed: int, steps: int | None = None, watch: Callable[[int], None] | None = None) -> Played:
        """An episode, the same every time, or its first steps.

        watch: called with the number of each step, before it is taken.
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
        return Played(self.env.side, (*self.links, *self.props), position, action, poses, by_name)

    def capture(self, camera: Camera, size: tuple[int, int]) -> Frame:
        """What the simulator draws of this instant for a camera that stands in the world; size: width, height."""
        return self.env.renderer.capture(camera, size, None, self.env.scene.classes, self.env.scene.parts)

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def _state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joints (14,), poses (bodies, 4, 4) and props (props, 7) at this instant."""
        scene = self.env.scene
        props = [scene.pose(name) for name in self.props]
        found = [*(scene.link_pose(name) for name in self.links), *props]
        poses = np.tile(np.eye(4), (len(found), 1, 1))
        for pose, here in zip(poses, found, strict=True):
            pose[:3, :3], pose[:3, 3] = here.rotation, here.position
        objects = [np.concatenate([prop.position, prop.quaternion]) for prop in props]
        return self.env.joint_positions(), poses, np.array(objects)
