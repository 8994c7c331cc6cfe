"""Clearance of a motion: between the arms, within an arm, and above a table."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from embodiedreamer_gym.engines.mujoco.bodies import MujocoBodies
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import TIME_STEP

LARGEST = 0.3  # m; larger distances count as this
NEIGHBOURS = 2  # joints between two links of an arm that may touch by design
TABLE = (4.0, 4.0, 0.5)  # m
Chain = list[tuple[int, int]]  # geoms of an arm that move, each with the number of joints between it and the base


def clearance(model: RobotModel, positions: np.ndarray, table: float | None = None) -> np.ndarray:
    """Smallest distance (K,), m, between parts that must not touch, at joint positions (K, n); at most 0.3.

    Parts: links of different arms, links of one arm with more than two joints between them, and a table and moving
    links. Links without a collision shape are left out.

    positions: (K, n) in the joints' units.
    table: its height in the frame of the URDF's root, m; None for no table.
    """

    def furnish(spec: Any) -> None:
        if table is not None:
            spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[x / 2 for x in TABLE],
                                    pos=(0.0, 0.0, table - TABLE[2] / 2))  # fmt: skip

    bodies = MujocoBodies(model, TIME_STEP, furnish)
    chains = _chains(bodies.model)
    pairs = _pairs(chains)
    if table is not None:
        board = bodies.model.geom("table").id
        pairs += [(board, geom) for chain in chains for geom, _ in chain]
    tree, least = model.tree, np.full(len(positions), LARGEST)
    for k, position in enumerate(positions):
        joints = tree.gain * position[tree.coordinate] + tree.offset
        bodies.place(joints, np.zeros_like(joints))
        mujoco.mj_kinematics(bodies.model, bodies.data)
        for one, other in pairs:
            least[k] = min(least[k], mujoco.mj_geomDistance(bodies.model, bodies.data, one, other, least[k], None))
    return least


def without_shape(model: RobotModel) -> tuple[str, ...]:
    """Names of the moving links without a collision shape, which `clearance` leaves out."""
    compiled = MujocoBodies(model, TIME_STEP, lambda spec: None).model
    shaped = set(compiled.geom_bodyid[np.flatnonzero(compiled.geom_contype)].tolist())
    moving = [body for body in range(1, compiled.nbody) if compiled.body_weldid[body] == body]
    return tuple(compiled.body(body).name for body in moving if body not in shaped and compiled.body_mass[body] > 0)


def _chains(model: Any) -> list[Chain]:
    """The moving collision shapes of each arm."""
    depth = np.zeros(model.nbody, int)
    for body in range(1, model.nbody):
        depth[body] = depth[model.body_parentid[body]] + model.body_jntnum[body]
    chains: dict[int, Chain] = {}
    for geom in np.flatnonzero(model.geom_contype).tolist():
        body = model.geom_bodyid[geom]
        if depth[body]:
            chains.setdefault(int(model.body_treeid[body]), []).append((geom, int(depth[body])))
    return list(chains.values())


def _pairs(chains: list[Chain]) -> list[tuple[int, int]]:
    """Pairs of shapes that must not touch."""
    pairs = [(a, b) for one, other in combinations(chains, 2) for a, _ in one for b, _ in other]
    for chain in chains:
        pairs += [(a, b) for (a, d), (b, e) in combinations(chain, 2) if abs(d - e) > NEIGHBOURS]
    return pairs
