"""Demonstrations of the ALOHA robot, made by moving its end effectors through key poses of a scene."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from embodiedreamer_gym.policies.key_pose.arms import Arms
from embodiedreamer_gym.policies.key_pose.skill import Demonstration
from embodiedreamer_gym.robot import RobotModel

HZ = 30.0
HOME = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 1.0] * 2)
Draw = Callable[[np.random.Generator], Demonstration]


@pytest.fixture(scope="session")
def arms() -> Arms:
    """Those of the ALOHA robot."""
    return Arms(RobotModel.load("aloha"))


def down(yaw: float) -> np.ndarray:
    """Rotation (3, 3) of a gripper that points down and closes along a direction, rad."""
    across = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    ahead = np.array([0.0, 0.0, -1.0])
    return np.array([np.cross(across, ahead), across, ahead]).T


def scene(rng: np.random.Generator) -> dict[str, tuple[float, float, float]]:
    """A bar and a plate on the left, the bar's axis anywhere."""
    x, y = rng.uniform(0.42, 0.5), rng.uniform(0.22, 0.36)
    return {"bar": (x, y, rng.uniform(-np.pi, np.pi)), "plate": (x + 0.06, y - 0.06, rng.uniform(-np.pi, np.pi))}


@pytest.fixture(scope="session")
def demonstration(arms: Arms) -> Draw:
    """Draws one: the bar is gripped across its folded axis, lifted, and put on the plate, turned outward."""

    def draw(rng: np.random.Generator) -> Demonstration:
        things, base = scene(rng), arms.arm.base
        (x, y, axis), (gx, gy, _) = things["bar"], things["plate"]
        out, away = np.arctan2(y - base[1], x - base[0]), np.arctan2(gy - base[1], gx - base[0])
        grip = down(out + (axis - out + np.pi / 2) % np.pi - np.pi / 2 + np.pi / 2)
        put = down(away + np.pi / 2)
        table = 0.76
        poses = [((x, y, table + 0.08), grip, 1.0), ((x, y, table), grip, 0.0), ((x, y, table + 0.1), grip, 0.0),
                 ((gx, gy, table + 0.1), put, 0.0), ((gx, gy, table + 0.01), put, 1.0), ((gx, gy, table + 0.1), put, 1.0)]  # fmt: skip
        here, rows, opening = HOME[:6], [HOME], 1.0
        for place, turn, then in poses:
            goal = arms.arm.solve(np.array(place), turn, here)
            if goal is None:
                return draw(rng)
            for share in np.linspace(0, 1, 31)[1:]:
                s = share**3 * (10 - 15 * share + 6 * share**2)
                rows.append(np.concatenate([here + s * (goal - here), [opening], HOME[7:]]))
            here = goal
            if then != opening:
                opening = then
                rows += [np.concatenate([here, [opening], HOME[7:]])] * 15
        states = np.array(rows)
        if rng.random() < 0.5:
            return Demonstration(states, states, HZ, things)
        image = {name: (a, -b, -c) for name, (a, b, c) in things.items()}
        return Demonstration(arms.mirrored(states), arms.mirrored(states), HZ, image)

    return draw


@pytest.fixture(scope="session")
def demonstrations(demonstration: Draw) -> list[Demonstration]:
    """Twelve of them, of both arms."""
    rng = np.random.default_rng(0)
    return [demonstration(rng) for _ in range(12)]


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Between two rotations (3, 3), rad."""
    return float(Rotation.from_matrix(a @ b.T).magnitude())
