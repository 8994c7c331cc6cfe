"""Hulls of what casts shadows: every pixel of a part lies inside its hull, projected."""

from __future__ import annotations

import cv2
import numpy as np

from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.geometry.hull import POINTS, directions, hull_points


def test_directions_are_spread_evenly() -> None:
    found = directions()
    assert np.allclose(np.linalg.norm(found, axis=1), 1) and np.abs(found.mean(axis=0)).max() < 0.02
    apart = np.arccos(np.clip(found @ found.T - 2 * np.eye(len(found)), -1, 1)).min(axis=1)
    assert apart.min() > 0.6 * apart.max()


def test_a_box_has_its_corners() -> None:
    corners = np.stack(np.meshgrid(*([(-1.0, 1.0)] * 3)), -1).reshape(-1, 3)
    found = hull_points(np.concatenate([corners, 0.3 * corners]))
    assert found.shape == (POINTS, 3) and len(np.unique(found, axis=0)) == 8 and (np.abs(found) == 1).all()


def test_hulls_cover_the_pixels_of_links_and_props() -> None:
    env = AlohaEnv("PutCupOnMat", obs_type="state", renderer="tiny")
    env.reset(seed=0)
    frame = env.capture("head", (256, 192))
    names, covered = env.engine.part_names, 0
    for number, (hull, projection) in enumerate(zip(frame.hulls, frame.projections, strict=True), 1):
        pixels = frame.parts == number
        if pixels.any():
            seen = hull @ projection[:, :3].T + projection[:, 3]
            outline = cv2.convexHull(np.round(seen[:, :2] / seen[:, 2:]).astype(np.int32))
            inside = cv2.fillConvexPoly(np.zeros(pixels.shape, np.uint8), outline, 1) > 0
            assert (pixels & ~inside).sum() <= 0.02 * pixels.sum() + 2, names[number - 1]
            assert inside.sum() < 3 * pixels.sum() or number - 1 < names.index("cup"), names[number - 1]
            covered += 1
    assert covered > 10 and not frame.hulls[names.index("left_gripper_tip")].any()
    assert stacked([frame, frame])["hulls"].shape == (len(names), POINTS, 3)
    env.close()
