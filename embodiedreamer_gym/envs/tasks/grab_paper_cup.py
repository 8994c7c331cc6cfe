"""Grab a paper cup."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import beaker, frustum
from embodiedreamer_gym.envs.tasks.grips import outward
from embodiedreamer_gym.envs.tasks.task import Situation, Task
from embodiedreamer_gym.geometry.pose import Pose

HEIGHT, BOTTOM, TOP = 0.085, 0.026, 0.032  # m; between a 7 oz and a 9 oz paper cup, see assets/SOURCES.md
GRIP = 0.05  # m above its base, where the gripper holds it
PITCHES = np.radians([75.0, 65.0, 55.0])  # of the gripper, below the horizontal
CUP = Prop("cup", (2 * TOP, 2 * TOP, HEIGHT), 0.03, (0.85, 0.33, 0.2, 1.0),
           (beaker(BOTTOM, TOP, HEIGHT, 0.002),), (frustum(BOTTOM, TOP, HEIGHT),))  # fmt: skip


class GrabPaperCup(Task):
    """Done while the cup is held above the table."""

    description = "grab the paper cup"
    object = CUP

    def target(self, situation: Situation) -> np.ndarray:
        """The point where the cup is gripped."""
        return self.handle(situation)

    def handle(self, situation: Situation) -> np.ndarray:
        """The middle of the cup."""
        return situation.object.point((0.0, 0.0, GRIP))

    def done(self, situation: Situation) -> bool:
        """Whether the cup is held and lifted."""
        return self.picked_up(situation)

    def grips(self, situation: Situation) -> Iterator[Pose]:
        """Poses that slant down towards the cup, pointing away from the arm."""
        for pitch in PITCHES:
            yield outward(situation, self.handle(situation), pitch)
