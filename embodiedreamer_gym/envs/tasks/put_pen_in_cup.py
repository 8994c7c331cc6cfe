"""Put a pen into a pen holder."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape, beaker, frustum, staves
from embodiedreamer_gym.envs.tasks.grips import downward, outward, ways
from embodiedreamer_gym.envs.tasks.task import Situation, Task
from embodiedreamer_gym.geometry.pose import Pose

LENGTH, THICK = 0.145, 0.012  # m
BLUE = (0.1, 0.2, 0.6, 1.0)
NIB, CAP = 0.015, 0.04  # m of its length
PEN = Prop(
    "pen", (LENGTH, THICK, THICK), 0.02, (0.85, 0.85, 0.82, 1.0),
    shapes=(Shape("cylinder", (THICK / 2, LENGTH - NIB - CAP), ((CAP - NIB) / 2, 0.0, THICK / 2), (0.0, np.pi / 2, 0.0)),
            Shape("cylinder", (THICK / 2, CAP), ((CAP - LENGTH) / 2, 0.0, THICK / 2), (0.0, np.pi / 2, 0.0), BLUE),
            frustum(THICK / 2, 0.001, NIB, position=(LENGTH / 2 - NIB, 0.0, THICK / 2), rpy=(0.0, np.pi / 2, 0.0), rgba=BLUE)),
    hull=(Shape("box", (LENGTH, THICK, THICK), (0.0, 0.0, THICK / 2)),),
)  # fmt: skip
RADIUS, HEIGHT, WALL = 0.04, 0.1, 0.003  # m
BOTTOM = Shape("cylinder", (RADIUS - WALL, WALL), (0.0, 0.0, WALL / 2))
HOLDER = Prop("holder", (2 * RADIUS, 2 * RADIUS, HEIGHT), 0.2, (0.2, 0.45, 0.42, 1.0),
              (beaker(RADIUS, RADIUS, HEIGHT, WALL),), (*staves(RADIUS, HEIGHT, WALL), BOTTOM), fixed=True)  # fmt: skip
END = 0.035  # m from the end that stays up, where the gripper holds the pen
HANG = LENGTH - END
GRIP = 0.008  # m above the table: the fingers end 4 mm lower
DEPTH = 0.04  # m of the pen inside the holder when it is let go
PITCHES = np.radians([20.0, 25.0, 30.0, 35.0, 40.0])  # of the gripper, below the horizontal
SIDE = HANG * np.sin(PITCHES[2]) - 0.5 * DEPTH * np.tan(PITCHES[2])  # m from the holder's axis to the gripper


class PutPenInCup(Task):
    """Done when the pen stands at rest with its lower end inside the holder, and the gripper has let go."""

    description = "put the pen into the pen holder"
    object = PEN
    goal = HOLDER
    opening = 0.6
    area = ((0.40, 0.55), (0.16, 0.44))
    goal_area = ((0.42, 0.60), (0.12, 0.48))

    def target(self, situation: Situation) -> np.ndarray:
        """Where the gripper is when it lets the pen go into the holder, at the middle one of the pitches."""
        away = (situation.goal.position - situation.base)[:2]
        x, y = SIDE * away / np.sqrt(away @ away)
        return situation.goal.position + np.array([x, y, HEIGHT - DEPTH + HANG * np.cos(PITCHES[2])])

    def done(self, situation: Situation) -> bool:
        """Whether the pen's lower end is in the lower half of the holder, and the pen at rest and released."""
        seen = (_ends(situation.object) - situation.goal.position) @ situation.goal.rotation
        lower = seen[np.argmin(seen[:, 2])]
        inside = np.linalg.norm(lower[:2]) < RADIUS and lower[2] < HEIGHT / 2
        return bool(inside and situation.on_goal and situation.speed < 0.02 and situation.fingers == 0)

    def handle(self, situation: Situation) -> np.ndarray:
        """Near the end away from the arm, so that the longer part hangs down from the gripper."""
        return _handles(situation)[0][0]

    def grips(self, situation: Situation) -> Iterator[Pose]:
        """Poses from above that close across the pen, first near the end away from the arm."""
        for point, across in _handles(situation):
            yield downward(point, across)

    def releases(self, situation: Situation) -> Iterator[Pose]:
        """Poses over the holder in which the pen leans away from the arm, with its lower end below the rim."""
        ends = (_ends(situation.object) - situation.tip.position) @ situation.tip.rotation
        end = ends[np.argmax(ends[:, 0])]
        for pitch in PITCHES:
            way = outward(situation, situation.goal.position, pitch)
            away = way.rotation[:, 2] * [1.0, 1.0, 0.0] / np.cos(pitch)
            place = situation.goal.point((0.0, 0.0, HEIGHT - DEPTH)) - 0.5 * DEPTH * np.tan(pitch) * away
            yield Pose(place - way.rotation @ end, way.quaternion)


def _handles(situation: Situation) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points (3,) where the pen may be gripped, each with the axis (3,) along which the gripper closes."""
    pen, across = situation.object, situation.object.rotation[:, 1]
    signs = ways(situation, pen.position, across)
    return [(pen.point((sign * (LENGTH / 2 - END), 0.0, GRIP)), sign * across) for sign in signs]


def _ends(pen: Pose) -> np.ndarray:
    """Both ends (2, 3) of a pen, m."""
    return np.array([pen.point((x, 0.0, THICK / 2)) for x in (-LENGTH / 2, LENGTH / 2)])
