"""Where an end effector is, and how far two of its trajectories lie apart.

Source: EmbodieDreamer, appendix on PhysAligner (translation and rotation error of a trajectory).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

    For a relative rotation by the angle a, ||R - R_ref||_F = 2 sqrt 2 sin(a / 2), so the law gives a / 2,
    half the angle between the two orientations.

    Raises: ModelError when the shapes differ or hold no pose.
    Source: EmbodieDreamer, appendix on PhysAligner.
    """
    r, r_ref = _pair(rotations, reference, (3, 3), "rotations")
    chord = np.linalg.norm(r - r_ref, axis=(1, 2)) / (2.0 * np.sqrt(2.0))
    return float(np.arcsin(np.minimum(chord, 1.0)).mean())  # rounding may exceed 1 at half a turn


def trajectory_error(poses: tuple[np.ndarray, np.ndarray], reference: tuple[np.ndarray, np.ndarray]) -> float:
    """Translation error, m, plus rotation error, rad, of poses: (positions (T, 3), rotations (T, 3, 3)).

    Raises: ModelError when the shapes differ or hold no pose.
    Source: EmbodieDreamer, appendix on PhysAligner: the two are added as plain numbers.
    """
    return translation_error(poses[0], reference[0]) + rotation_error(poses[1], reference[1])


class EndEffector:
    """Forward kinematics of one link of a URDF (its path or its text), seen from the root link.

    In float64, but pytorch-kinematics reads the URDF's figures in float32: positions are good to 0.3 um.
    """

    def __init__(self, urdf: str | Path, link: str) -> None:
        # Late: pytorch-kinematics brings torch, which takes seconds to import.
        import pytorch_kinematics
        import torch

        data, source = _read(urdf)
        robot = _parsed(data, source)
        links = [entry.get("name", "") for entry in robot.findall("link")]
        if link not in links:
            raise ModelError(f"{source} has no link '{link}'; links: {', '.join(links)}.")
        self.link = link
        self._mimics = _mimics(robot)
        self._tensor = torch.from_numpy
        chain = pytorch_kinematics.build_serial_chain_from_urdf(data, link)
        self._chain = chain.to(dtype=torch.float64)
        self.joints: tuple[str, ...] = tuple(self._chain.get_joint_parameter_names())

    def __repr__(self) -> str:
        return f"EndEffector({self.link!r}, {len(self.joints)} joints)"

    def pose(self, values: np.ndarray, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Positions (T, 3), m, and rotations (T, 3, 3) at joint values (T, n), rad or m as in the URDF.

        Joints that do not move the link are ignored; a mimic joint without own values follows its leader.

        Raises: ModelError when values and joints do not fit, or a joint that moves the link has no values.
        """
        values = np.asarray(values, float)
        if values.ndim != 2 or values.shape[1] != len(joints):
            raise ModelError(
                f"joint values have the shape {values.shape}, but these joints need (T, {len(joints)})"
                " with one row for each time."
            )
        given = dict(zip(joints, values.T, strict=True))
        columns = [self._values(name, given) for name in self.joints]
        chain = np.stack(columns, axis=1) if columns else np.zeros((len(values), 0))
        tip = self._chain.forward_kinematics(self._tensor(chain))
        matrix = tip.get_matrix().numpy()  # pyright: ignore[reportAttributeAccessIssue]
        return matrix[:, :3, 3].copy(), matrix[:, :3, :3].copy()

    def _values(self, name: str, given: Mapping[str, np.ndarray]) -> np.ndarray:
        """Values (T,) of a joint of the chain: its own, else its leader's."""
        if name in given:
            return given[name]
        if name in self._mimics:
            leader, gain, offset = self._mimics[name]
            return gain * self._values(leader, given) + offset
        raise ModelError(
            f"joint '{name}' moves '{self.link}' but has no values; given are {', '.join(given) or 'none'}."
        )


def _pair(given: np.ndarray, reference: np.ndarray, shape: tuple[int, ...], what: str) -> tuple[np.ndarray, np.ndarray]:
    """Both as float arrays (T, *shape), T at least 1."""
    a, b = np.asarray(given, float), np.asarray(reference, float)
    if a.shape != b.shape or a.shape[1:] != shape or not len(a):
        wanted = ", ".join(map(str, ("T", *shape)))
        raise ModelError(
            f"{what} have the shapes {a.shape} and {b.shape}, but both must be ({wanted}), with the same T."
        )
    return a, b


def _read(urdf: str | Path) -> tuple[bytes, str]:
    """Content of a URDF given as text or path, and what to call it in an error."""
    if isinstance(urdf, str) and urdf.lstrip().startswith("<"):
        return urdf.encode(), "the URDF"
    path = Path(urdf)
    if not path.is_file():
        raise ModelError(f"URDF {path} does not exist.")
    return path.read_bytes(), path.name


def _parsed(data: bytes, source: str) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise ModelError(f"{source} is no XML: {error}.") from error


def _mimics(robot: ElementTree.Element) -> dict[str, tuple[str, float, float]]:
    """Mimic joint -> (leader, multiplier, offset); pytorch-kinematics itself does not know them."""
    return {
        joint.get("name", ""): (
            mimic.get("joint", ""), float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0)),
        )
        for joint in robot.findall("joint")
        for mimic in joint.findall("mimic")
    }  # fmt: skip
