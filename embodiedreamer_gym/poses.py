"""Where an end effector is, and how far two of its trajectories lie apart.

Source: EmbodieDreamer, appendix on PhysAligner (translation and rotation error of a trajectory).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from embodiedreamer_gym.errors import ModelError


def translation_error(positions: np.ndarray, reference: np.ndarray) -> float:
    """Mean Euclidean distance, m, of positions (T, 3), m, from a reference (T, 3), m.

    Raises: ModelError when the shapes differ or hold no pose.
    Source: EmbodieDreamer, appendix on PhysAligner.
    """
    x, x_ref = _pair(positions, reference, (3,), "positions")
    return float(np.linalg.norm(x - x_ref, axis=1).mean())


def rotation_error(rotations: np.ndarray, reference: np.ndarray) -> float:
    """Mean of arcsin(||R - R_ref||_F / (2 sqrt 2)), rad, over rotations (T, 3, 3) and a reference (T, 3, 3).

    For a relative rotation by the angle a, ||R - R_ref||_F = 2 sqrt 2 sin(a / 2): the paper's law gives a / 2, half
    the angle between the two orientations.

    Raises: ModelError when the shapes differ or hold no pose.
    Source: EmbodieDreamer, appendix on PhysAligner.
    """
    r, r_ref = _pair(rotations, reference, (3, 3), "rotations")
    chord = np.linalg.norm(r - r_ref, axis=(1, 2)) / (2.0 * np.sqrt(2.0))
    return float(np.arcsin(np.minimum(chord, 1.0)).mean())  # rounding may exceed 1 at half a turn


def trajectory_error(
    poses: tuple[np.ndarray, np.ndarray], reference: tuple[np.ndarray, np.ndarray]
) -> float:
    """Translation error in m plus rotation error in rad of poses, each (positions (T, 3), rotations (T, 3, 3)).

    Raises: ModelError when the shapes differ or hold no pose.
    Source: EmbodieDreamer, appendix on PhysAligner: the two are added as plain numbers.
    """
    return translation_error(poses[0], reference[0]) + rotation_error(poses[1], reference[1])


class EndEffector:
    """Forward kinematics of one link of a URDF (its path or its text), seen from the root link, in float64."""

    def __init__(self, urdf: str | Path, link: str) -> None:
        # Late: pytorch-kinematics brings torch, which takes seconds to import.
        import pytorch_kinematics
        import torch

        data, self.source = _read(urdf)
        robot = _parsed(data, self.source)
        links = [entry.get("name", "") for entry in robot.findall("link")]
        if link not in links:
            raise ModelError(f"{self.source} has no link '{link}'; links: {', '.join(links)}.")
        self.link = link
        self._fixed = (np.eye(3), np.zeros(3)) if link not in _parents(robot) else None  # the root itself
        self._mimics = _mimics(robot)
        self._torch = torch
        self._chain = None
        self.joints: tuple[str, ...] = ()
        if self._fixed is None:
            chain = pytorch_kinematics.build_serial_chain_from_urdf(data, link).to(dtype=torch.float64)
            self._chain, self.joints = chain, tuple(chain.get_joint_parameter_names())

    def __repr__(self) -> str:
        return f"EndEffector({self.link!r}, {len(self.joints)} joints)"

    def pose(self, values: np.ndarray, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Positions (T, 3), m, and rotations (T, 3, 3) at joint values (T, n), rad or m as the URDF has them.

        Joints that do not move the link are ignored; a mimic joint without values of its own follows its leader.

        Raises: ModelError when values and joints do not fit or a joint that moves the link has no value.
        """
        values = np.asarray(values, float)
        if values.ndim != 2 or values.shape[1] != len(joints):
            raise ModelError(f"joint values have shape {values.shape}, but must be (T, {len(joints)}): one column a joint.")
        given = {name: values[:, column] for column, name in enumerate(joints)}
        columns = [self._values_of(name, given) for name in self.joints]
        if self._chain is None or not columns:
            values = np.zeros((len(values), 0))
        else:
            values = np.stack(columns, axis=1)
        if self._fixed is not None:
            rotation, position = self._fixed
            return np.tile(position, (len(values), 1)), np.tile(rotation, (len(values), 1, 1))
        matrix = self._matrix(values)
        return matrix[:, :3, 3].copy(), matrix[:, :3, :3].copy()
