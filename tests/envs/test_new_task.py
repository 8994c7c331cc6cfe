"""Adding a task is a file like this one: props, what counts as done, and where a hand takes and lets go."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from embodiedreamer_gym.engines.prop import Prop
from embodiedreamer_gym.engines.shapes import Shape
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.envs.tasks import TASKS, Task
from embodiedreamer_gym.envs.tasks.grips import downward
from embodiedreamer_gym.envs.tasks.task import Situation
from embodiedreamer_gym.geometry.pose import Pose

EDGE, THICK = 0.04, 0.01  # m
BLOCK = Prop("block", (EDGE,) * 3, 0.05, (0.8, 0.2, 0.2, 1.0), (Shape("box", (EDGE,) * 3, (0.0, 0.0, EDGE / 2)),))
TILE = Prop("tile", (0.1, 0.1, THICK), 0.3, (0.3, 0.3, 0.3, 1.0), (Shape("box", (0.1, 0.1, THICK), (0, 0, THICK / 2)),))


class PutBlockOnTile(Task):
    """Done when the block rests on the tile, which is not fixed."""

    description = "put the block on the tile"
    object = BLOCK
    goal = TILE

    def target(self, situation: Situation) -> np.ndarray:
        return situation.goal.point((0.0, 0.0, THICK + EDGE / 2 + 0.003))

    def done(self, situation: Situation) -> bool:
        return situation.on_goal and not situation.on_table and situation.fingers == 0 and situation.speed < 0.02

    def grips(self, situation: Situation) -> Iterator[Pose]:
        for axis in (0, 1):
            yield downward(situation.object.point((0.0, 0.0, EDGE / 2)), situation.object.rotation[:, axis])

    def releases(self, situation: Situation) -> Iterator[Pose]:
        for axis in (0, 1):
            yield downward(self.target(situation), situation.goal.rotation[:, axis])


def test_a_new_task_has_an_environment_and_an_expert(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TASKS, "PutBlockOnTile", PutBlockOnTile)
    env = AlohaEnv(task="PutBlockOnTile", obs_type="state")
    for seed in range(3):
        env.reset(seed=seed)
        expert, info = ScriptedExpert(env), {}
        for _ in range(250):
            info = env.step(expert.act())[-1]
        assert info["is_success"], f"seed {seed}"
    assert env.segmentation_classes[-2:] == ("block", "tile")
    env.close()
