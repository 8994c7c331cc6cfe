"""The interface of a task: props, their placement, the end effector's target, and when the task is done."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.table import TABLE_HEIGHT
from embodiedreamer_gym.envs.arguments import check_choice, check_mapping, vector
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.geometry.pose import Pose

SIDES = ("left", "right")
GAP = 0.03  # m left free between two props
TRIES = 1000

Area = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Situation:
    """State of the world at one instant, from which a task is judged.

    side: the acting arm; base (3,): where that arm is mounted, m; tip: its end effector's pose; object, goal: poses of
    the props (goal is the object's own if a task has none); start: where the object stood at the reset; speed: of
    the object, m/s; fingers: how many of the acting arm's fingers touch the object; on_goal: whether the object touches
    the goal; on_table: whether it touches the table; grasped: whether it has been picked up in this episode.
    """

    side: str
    base: np.ndarray
    tip: Pose
    object: Pose
    goal: Pose
    start: Pose
    speed: float
    fingers: int
    on_goal: bool
    on_table: bool
    grasped: bool

    @property
    def lifted(self) -> float:
        """Height of the object above its start, m."""
        return float(self.object.position[2] - self.start.position[2])


class Task:
    """A task of one arm with one object; a subclass defines props and description, and overrides what differs.

    area: where the object may stand on the left side, ranges of x and y, m, mirrored for the right arm; goal_area: the
    same for the goal, where it differs; lift: height above its start at which a held object counts as picked up, m;
    opening: of the gripper (0..1) around the object, for the expert.
    """

    description: ClassVar[str]
    object: ClassVar[Prop]
    goal: ClassVar[Prop | None] = None
    area: ClassVar[Area] = ((0.42, 0.60), (0.16, 0.44))
    goal_area: ClassVar[Area | None] = None
    lift: ClassVar[float] = 0.03
    opening: ClassVar[float] = 1.0

    @property
    def props(self) -> tuple[Prop, ...]:
        """The object first, then the goal."""
        return (self.object,) if self.goal is None else (self.object, self.goal)

    # ---- where things stand ------------------------------------------------------------------------------------

    def place(self, rng: np.random.Generator) -> tuple[str, Mapping[str, Pose]]:
        """Draw the acting side and the pose of each prop: apart from each other and within reach.

        Raises: SimulationError when the areas are too small for the props.
        """
        side = SIDES[int(rng.integers(2))]
        apart = GAP + sum(prop.radius for prop in self.props)
        for _ in range(TRIES):
            poses = {prop.name: self.draw(prop, side, rng) for prop in self.props}
            centres = [pose.position for pose in poses.values()]
            if np.linalg.norm(centres[0] - centres[-1]) > apart or len(centres) == 1:
                return side, poses
        raise SimulationError(f"task {type(self).__name__} has no room for its props {apart:.2f} m apart.")

    def draw(self, prop: Prop, side: str, rng: np.random.Generator) -> Pose:
        """Draw one prop's pose on the side of an arm."""
        (x0, x1), (y0, y1) = self.goal_area if prop is self.goal and self.goal_area else self.area
        x, y = rng.uniform(x0, x1), rng.uniform(y0, y1) * (1.0 if side == "left" else -1.0)
        yaw = float(rng.uniform(-np.pi, np.pi))
        return Pose(np.array([x, y, TABLE_HEIGHT]), np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)]))

    # ---- what is to be done ------------------------------------------------------------------------------------

    def target(self, situation: Situation) -> np.ndarray:
        """Final target (3,) of the end effector, m."""
        raise NotImplementedError

    def handle(self, situation: Situation) -> np.ndarray:
        """Position (3,) of the end effector when it grips the object, m."""
        return situation.object.position

    def picked_up(self, situation: Situation) -> bool:
        """Whether the object is held by both fingers and off the table."""
        return situation.fingers == 2 and not situation.on_table and situation.lifted > self.lift

    def done(self, situation: Situation) -> bool:
        """Whether the task is done in this situation, given that the object has been picked up."""
        raise NotImplementedError

    # ---- how an expert does it ---------------------------------------------------------------------------------

    def grips(self, situation: Situation) -> Iterator[Pose]:
        """Poses of the end effector in which the gripper may close on the object, the best first."""
        raise NotImplementedError

    def releases(self, situation: Situation) -> Iterator[Pose]:
        """Poses of the end effector in which the gripper may open over the goal, best first; none without a goal."""
        yield from ()


def placed(
    side: str, poses: Mapping[str, Pose], wanted: Any, thing: str
) -> tuple[str, Mapping[str, Pose]]:  # fmt: skip
    """Acting side and poses of the props, some set by the user: prop -> position m and quaternion xyzw (7,).

    If the pose of the object `thing` is set, the arm on its side acts.
    Raises: SimulationError for an unknown prop, or an invalid pose.
    """
    found = dict(poses)
    for name, value in check_mapping("object_poses", wanted).items():
        pose = vector(f"pose of {check_choice('prop', name, found)}", value, 7)
        if not 0.9 < np.linalg.norm(pose[3:]) < 1.1:
            raise SimulationError(f"pose of {name}: the last four numbers are not a unit quaternion xyzw.")
        found[name] = Pose(pose[:3], pose[3:])
    if thing in (wanted or ()):
        side = SIDES[int(found[thing].position[1] < 0)]
    return side, found
