"""Errors between two trajectories of an end effector.

Source: EmbodieDreamer, appendix on PhysAligner (translation and rotation error of a trajectory).
"""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import ModelError


def translation_error(positions: np.ndarray, reference: np.ndarray) -> float:
    """Mean Euclidean distance, m, of positions (T, 3), m, from a reference (T, 3), m.

    Raises: ModelError when the shapes differ or are empty.
    Source: EmbodieDreamer, appendix on PhysAligner.
    """
    x, x_ref = _pair(positions, reference, (3,), "positions")
    return float(np.linalg.norm(x - x_ref, axis=1).mean())


def rotation_error(rotations: np.ndarray, reference: np.ndarray) -> float:
    """Mean of arcsin(||R - R_ref||_F / (2 sqrt 2)), rad, over rotations (T, 3, 3) and a reference (T, 3, 3).

    For a relative rotation by the angle a, ||R - R_ref||_F = 2 sqrt 2 sin(a / 2), so the formula gives a / 2,
    half the angle between the two orientations.

    Raises: ModelError when the shapes differ or are empty.
    Source: EmbodieDreamer, appendix on PhysAligner.
    """
    r, r_ref = _pair(rotations, reference, (3, 3), "rotations")
    chord = np.linalg.norm(r - r_ref, axis=(1, 2)) / (2.0 * np.sqrt(2.0))
    return float(np.arcsin(np.minimum(chord, 1.0)).mean())  # rounding may exceed 1 at half a turn


def trajectory_error(poses: tuple[np.ndarray, np.ndarray], reference: tuple[np.ndarray, np.ndarray]) -> float:
    """Translation error, m, plus rotation error, rad, of poses: (positions (T, 3), rotations (T, 3, 3)).

    Raises: ModelError when the shapes differ or are empty.
    Source: EmbodieDreamer, appendix on PhysAligner: the two are added without units.
    """
    return translation_error(poses[0], reference[0]) + rotation_error(poses[1], reference[1])


def _pair(given: np.ndarray, reference: np.ndarray, shape: tuple[int, ...], what: str) -> tuple[np.ndarray, np.ndarray]:
    """Both as float arrays (T, *shape), with T at least 1."""
    a, b = np.asarray(given, float), np.asarray(reference, float)
    if a.shape != b.shape or a.shape[1:] != shape or not len(a):
        wanted = ", ".join(map(str, ("T", *shape)))
        raise ModelError(
            f"{what} have the shapes {a.shape} and {b.shape}, but both must be ({wanted}), with the same T."
        )
    return a, b
