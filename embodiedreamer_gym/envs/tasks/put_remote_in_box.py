"""Put a remote control into a box."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape, open_box
from embodiedreamer_gym.envs.tasks.grips import downward, ways
from embodiedreamer_gym.envs.tasks.task import Situation, Task
from embodiedreamer_gym.geometry.pose import Pose

LENGTH, WIDTH, THICK = 0.16, 0.046, 0.02  # m
BUTTONS = [(x, y) for x in (-0.03, -0.01, 0.01, 0.03) for y in (-0.012, 0.0, 0.012)]
REMOTE = Prop(
    "remote", (LENGTH, WIDTH, THICK), 0.1, (0.13, 0.13, 0.15, 1.0),
    shapes=(Shape("box", (LENGTH, WIDTH, THICK), (0.0, 0.0, THICK / 2)),
            Shape("box", (0.012, 0.012, 0.001), (0.06, 0.0, THICK), rgba=(0.8, 0.15, 0.12, 1.0)),
            *(Shape("box", (0.012, 0.008, 0.001), (x, y, THICK), rgba=(0.75, 0.75, 0.75, 1.0)) for x, y in BUTTONS)),
    hull=(Shape("box", (LENGTH, WIDTH, THICK), (0.0, 0.0, THICK / 2)),), friction=0.5,
)  # fmt: skip
DEPTH, BREADTH, HEIGHT, WALL = 0.22, 0.16, 0.07, 0.003  # m
BOX = Prop(
    "box", (DEPTH, BREADTH, HEIGHT), 0.2, (0.72, 0.54, 0.34, 1.0), open_box(DEPTH, BREADTH, HEIGHT, WALL), fixed=True
)
GRIP = 0.015  # m above its underside, where the gripper holds it
DROP = 0.01  # m it falls when let go


class PutRemoteInBox(Task):
    """Done when the remote lies at rest wholly inside the box, and the gripper has let go."""

    description = "put the remote control into the box"
    object = REMOTE
    goal = BOX
    area = ((0.42, 0.56), (0.10, 0.50))
    goal_area = ((0.48, 0.56), (0.08, 0.44))

    def target(self, situation: Situation) -> np.ndarray:
        """Where the gripper is when it lets the remote go."""
        return situation.goal.point((0.0, 0.0, WALL + DROP + GRIP))

    def done(self, situation: Situation) -> bool:
        """Whether the remote's corners are between the walls and below the rim, and it is at rest and released."""
        corners = [
            situation.object.point((x, y, THICK / 2))
            for x in (-LENGTH / 2, LENGTH / 2)
            for y in (-WIDTH / 2, WIDTH / 2)
        ]
        seen = (np.array(corners) - situation.goal.position) @ situation.goal.rotation
        inside = np.abs(seen[:, :2]).max(axis=0) < (DEPTH / 2, BREADTH / 2)
        low = seen[:, 2].max() < HEIGHT
        return bool(inside.all() and low and situation.on_goal and situation.speed < 0.02 and situation.fingers == 0)

    def handle(self, situation: Situation) -> np.ndarray:
        """The middle of the remote."""
        return situation.object.point((0.0, 0.0, GRIP))

    def grips(self, situation: Situation) -> Iterator[Pose]:
        """Poses from above that close across its middle."""
        point, across = self.handle(situation), situation.object.rotation[:, 1]
        for way in ways(situation, point, across):
            yield downward(point, way * across)

    def releases(self, situation: Situation) -> Iterator[Pose]:
        """Poses over the middle of the box, with the remote along the box."""
        point, across = self.target(situation), situation.goal.rotation[:, 1]
        for way in ways(situation, point, across):
            yield downward(point, way * across)
