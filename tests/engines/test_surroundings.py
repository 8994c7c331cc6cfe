"""To a camera that moves with a link, table and background are rigid parts too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from embodiedreamer_gym.engines.table import TABLE
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.errors import EmbodieDreamerError
from tests.opengl import skip_without_pictures

SIZE = (128, 96)


@pytest.fixture(scope="module", params=["bullet", "mujoco"])
def env(request) -> Iterator[AlohaEnv]:
    if request.param == "mujoco":
        skip_without_pictures()
    try:
        made = AlohaEnv("PutCupOnMat", obs_type="state", engine=request.param)
    except EmbodieDreamerError as error:
        pytest.skip(f"{request.param} cannot draw here: {error}")
    made.reset(seed=0)
    yield made
    made.close()


def test_the_table_lies_where_its_projection_says(env: AlohaEnv) -> None:
    frame = env.capture("left_wrist", SIZE)
    links = len(env.engine.part_names) - 2  # the cup and the mat come last
    rows, columns = np.nonzero(frame.segmentation == 1)
    assert len(rows) > 20 and (frame.parts[rows, columns] == links + 1).all()
    world = frame.projections[links].astype(float)
    depth = frame.depth[rows, columns]
    points = np.linalg.solve(world[:, :3], np.stack([columns * depth, rows * depth, depth]) - world[:, 3:])
    top = points[2] > TABLE.size[2] - 0.01  # not its edge
    assert top.mean() > 0.5 and np.abs(points[2][top] - TABLE.size[2]).max() < 2e-3


def test_the_background_is_a_part_that_only_turning_moves(env: AlohaEnv) -> None:
    frame = env.capture("left_wrist", SIZE)
    links = len(env.engine.part_names) - 2
    assert (frame.parts[frame.segmentation == 0] == links + 2).all() and (frame.segmentation == 0).any()
    near, far = frame.projections[links], frame.projections[links + 1]
    assert np.array_equal(near[:, :3], far[:, :3]) and not far[:, 3].any() and near[:, 3].any()


def test_props_keep_their_parts_behind_them(env: AlohaEnv) -> None:
    still, moving = env.capture("head", SIZE), env.capture("left_wrist", SIZE)
    assert len(moving.projections) == len(still.projections) + 2 == len(moving.hulls)
    links = len(env.engine.part_names) - 2
    assert np.array_equal(moving.hulls[links + 2 :], still.hulls[links:]) and not moving.hulls[links : links + 2].any()
    assert (still.parts[still.segmentation <= 1] == 0).all() and CAMERAS["head"].link is None
    assert set(np.unique(still.parts[still.segmentation == 3])) == {links + 1}
