"""Put a cup on a mat."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape, frustum
from embodiedreamer_gym.envs.tasks.grab_paper_cup import BOTTOM, CUP, GRIP, PITCHES, GrabPaperCup
from embodiedreamer_gym.envs.tasks.grips import outward
from embodiedreamer_gym.envs.tasks.task import Situation, Task
from embodiedreamer_gym.geometry.pose import Pose

RADIUS, THICK = 0.065, 0.004  # m
DROP = 0.003  # m that the cup falls when let go
MAT = Prop("mat", (2 * RADIUS, 2 * RADIUS, THICK), 0.05, (0.16, 0.36, 0.62, 1.0),
           (frustum(RADIUS, RADIUS, THICK),), (Shape("cylinder", (RADIUS, THICK), (0.0, 0.0, THICK / 2)),), fixed=True)  # fmt: skip


class PutCupOnMat(Task):
    """Done when the cup stands upright and at rest with its whole base on the mat, and the gripper has let go."""

    description = "put the cup on the mat"
    object = CUP
    goal = MAT

    def target(self, situation: Situation) -> np.ndarray:
        """Where the gripper is when it sets the cup down."""
        return situation.goal.point((0.0, 0.0, THICK + DROP + GRIP))

    def done(self, situation: Situation) -> bool:
        """Whether the cup is upright, at rest, wholly on the mat and released."""
        off = np.linalg.norm((situation.object.position - situation.goal.position)[:2])
        upright = situation.object.rotation[2, 2] > 0.98
        inside = off < RADIUS - BOTTOM
        return bool(situation.on_goal and upright and inside and situation.speed < 0.02 and situation.fingers == 0)

    def handle(self, situation: Situation) -> np.ndarray:
        """As in GrabPaperCup."""
        return GrabPaperCup().handle(situation)

    def grips(self, situation: Situation) -> Iterator[Pose]:
        """As in GrabPaperCup."""
        return GrabPaperCup().grips(situation)

    def releases(self, situation: Situation) -> Iterator[Pose]:
        """Poses that slant down towards the mat, at the height at which the gripper holds the cup."""
        held = situation.tip.position - situation.object.position
        for pitch in PITCHES:
            yield outward(situation, situation.goal.point((0.0, 0.0, THICK + DROP + held[2])), pitch)
