"""Notes on values in a URDF that look made up or are missing, and on their consequences: one sentence each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yourdfpy

from embodiedreamer_gym.robot.urdf import find_mesh, read_urdf, root_link

FEWEST = 3  # moving links, below which equal numbers may be chance
LIGHTEST = 1e-3  # kg; lighter links are frames
ROUNDED = 1.02  # times a sum of inertias, to allow for rounded numbers in a file
GYRATION = (5e-4, 1.0)  # m: plausible range for a link of an arm


def urdf_notes(urdf: str | Path) -> tuple[str, ...]:
    """Sentences on a URDF's inertias and meshes; none if nothing is unusual.

    Raises: ModelError if it cannot be read.
    """
    path = Path(urdf)
    robot = read_urdf(path)
    notes = _inertias(robot, path), _gyration(robot, path), _impossible(robot, path), _meshes(robot, path)
    return tuple(note for note in notes if note)


def _moving(robot: yourdfpy.Robot, path: Path) -> list[tuple[str, float, np.ndarray]]:
    """Name, mass (kg) and inertia (3, 3), kg m^2, of the links that have a mass, except the root."""
    root = root_link(robot, path)
    found = []
    for link in robot.links:
        one = link.inertial
        if one is not None and one.inertia is not None and (one.mass or 0.0) >= LIGHTEST and link.name != root:
            found.append((link.name, float(one.mass or 0.0), np.asarray(one.inertia, float)))
    return found


def _inertias(robot: yourdfpy.Robot, path: Path) -> str:
    """Note on placeholders: equal values of all links, or an inertia that is a power of ten about every axis."""
    links = _moving(robot, path)
    if len(links) < FEWEST:
        return ""
    masses, inertias = np.array([mass for _, mass, _ in links]), np.array([inertia for *_, inertia in links])
    round_ones = [_is_round(inertia) for inertia in inertias]
    if np.all(masses == masses[0]):
        what = f"all {len(links)} moving links have a mass of {masses[0]:g} kg"
    elif np.all(inertias == inertias[0]):
        what = f"all {len(links)} moving links have the same inertia, {inertias[0, 0, 0]:g} kg m^2"
    elif 2 * sum(round_ones) > len(links):
        what = f"{sum(round_ones)} of {len(links)} moving links have a round inertia that is the same about every axis"
    else:
        return ""
    return (
        f"{path.name}: {what}, which looks like placeholders: simulated gravity and inertia would be wrong, and an "
        "identified payload, torque bias, joint spring or rotor inertia may only compensate for that; take them from "
        "CAD, or give --urdf-trust 100,50,100"
    )


def _is_round(inertia: np.ndarray) -> bool:
    """Whether an inertia is a power of ten about every axis, as some editors insert."""
    value = inertia[0, 0]
    if not value > 0 or not np.array_equal(inertia, value * np.eye(3)):
        return False
    exponent = np.log10(value)
    return bool(abs(exponent - round(exponent)) < 1e-6)


def _gyration(robot: yourdfpy.Robot, path: Path) -> str:
    """Note on links whose inertia does not fit their mass, as after a change of units."""
    odd = []
    for name, mass, inertia in _moving(robot, path):
        radius = float(np.sqrt(max(np.trace(inertia), 0.0) / 2 / mass))
        if not GYRATION[0] <= radius <= GYRATION[1]:
            odd.append(f"{name} ({1e3 * radius:.3g} mm)")
    if not odd:
        return ""
    return (
        f"{path.name}: inertia and mass of {', '.join(odd[:4])}{' and others' if len(odd) > 4 else ''} do not fit "
        "each other, by the radius of gyration: check the units (kg, kg m^2); quick motion is simulated wrongly, and "
        "an identified rotor inertia may only compensate for that"
    )


def _impossible(robot: yourdfpy.Robot, path: Path) -> str:
    """Note on inertias that no body has: about one axis larger than the sum of those about the other two."""
    odd = []
    for name, _, inertia in _moving(robot, path):
        principal = np.linalg.eigvalsh((inertia + inertia.T) / 2)
        if principal[2] > ROUNDED * (principal[0] + principal[1]):
            odd.append(name)
    if not odd:
        return ""
    return (
        f"{path.name}: no body can have the inertia of {', '.join(odd[:4])}{' and others' if len(odd) > 4 else ''}, which is "
        "larger about one axis than the sum about the other two; quick motion is simulated wrongly, and an identified "
        "rotor inertia may only compensate for that"
    )


def _meshes(robot: yourdfpy.Robot, path: Path) -> str:
    """Note on missing meshes."""
    shapes = [shape.geometry for link in robot.links for shape in (*link.visuals, *link.collisions)]
    meshes = [one.mesh for one in shapes if one is not None and one.mesh is not None]
    names = list(dict.fromkeys(mesh.filename for mesh in meshes))
    missing = [name for name in names if find_mesh(name, path) is None]
    if not missing:
        return ""
    return (
        f"{path.name}: {len(missing)} of {len(names)} meshes are not found ({missing[0]}): results do not depend on "
        "them, but pictures lack these shapes, and `excite` cannot avoid collisions with them; put them beside the "
        "URDF"
    )
