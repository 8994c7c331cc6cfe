"""How much room a motion leaves: between the arms, within an arm, and above a table."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from embodiedreamer_gym.engines.bullet.client import pybullet
from embodiedreamer_gym.engines.bullet.plant import BulletPlant
from embodiedreamer_gym.robot import RobotModel

SIGHT = 0.3  # m; what is further apart counts as this far
NEIGHBOURS = 2  # joints between two links of an arm that may touch by design
TABLE = (4.0, 4.0, 0.5)  # m


def clearance(model: RobotModel, positions: np.ndarray, table: float | None = None) -> np.ndarray:
    """Least distance (K,), m, between parts that must not touch, at joint positions (K, n); at most 0.3.

    Parts: links of different arms, links of one arm with two joints or more between them, and, where its height (m, in the
    frame of the URDF's root) is given, a table and what moves. Links without a collision shape are not seen.
    """
    with BulletPlant(model) as plant:
        client = plant.client
        pairs = _pairs(plant)
        if table is not None:
            shape = client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[x / 2 for x in TABLE])
            board = client.createMultiBody(0.0, shape, basePosition=(0.0, 0.0, table - TABLE[2] / 2))
            pairs += [((board, -1), link) for link in _moving(plant)]
        least = np.full(len(positions), SIGHT)
        still = np.zeros(model.n)
        for k, position in enumerate(positions):
            plant.reset(position, still, position)
            for (a, i), (b, j) in pairs:
                near = client.getClosestPoints(a, b, float(least[k]), i, j)
                least[k] = min([least[k], *(point[8] for point in near)])
    return least


def _moving(plant: BulletPlant) -> list[tuple[int, int]]:
    """Links that a driven joint moves and that have a shape."""
    return [link for arm in _chains(plant) for link, _ in arm]


def _chains(plant: BulletPlant) -> list[list[tuple[tuple[int, int], int]]]:
    """For each arm its moving links with a shape, and how many joints stand between each and the base."""
    client, arms = plant.client, []
    for body in plant.ids:
        depth: dict[int, int] = {-1: 0}
        found = []
        for link in range(client.getNumJoints(body)):
            info = client.getJointInfo(body, link)
            depth[link] = depth[info[16]] + (info[2] != pybullet.JOINT_FIXED)
            if depth[link] and client.getCollisionShapeData(body, link):
                found.append(((body, link), depth[link]))
        arms.append(found)
    return arms


def _pairs(plant: BulletPlant) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    chains = _chains(plant)
    pairs = [(a, b) for one, other in combinations(chains, 2) for a, _ in one for b, _ in other]
    for chain in chains:
        pairs += [(a, b) for (a, d), (b, e) in combinations(chain, 2) if abs(d - e) > NEIGHBOURS]
    return pairs
