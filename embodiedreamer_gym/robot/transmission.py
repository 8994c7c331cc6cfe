"""The transmission between the motors of a log and the joints of a model: gears, coupled joints, signs and zeros."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording

WORST = 1e6  # largest condition number of a matrix that can be inverted


@dataclass(frozen=True, eq=False)
class Transmission:
    """joint = matrix (sign (motor - zero)); its transposed inverse converts motor efforts to joint torques.

    motors: names in the logs, in the order of the columns; matrix (n, n): rows are joints, in joint units per motor
    unit; sign (n,): 1 or -1; zero (n,): value of each motor in the log when the joint is at zero, in the motor's unit.
    Raises: ModelError if names repeat, or the matrix has no inverse.
    """

    motors: tuple[str, ...]
    matrix: np.ndarray
    sign: np.ndarray
    zero: np.ndarray

    def __post_init__(self) -> None:
        n = len(self.motors)
        for name, shape in (("matrix", (n, n)), ("sign", (n,)), ("zero", (n,))):
            values = np.array(getattr(self, name), float)
            if values.shape != shape or not np.isfinite(values).all():
                raise ModelError(f"transmission: {name} must be finite numbers of shape {shape}, not {values.shape}.")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if len(set(self.motors)) < n:
            raise ModelError(f"transmission: the motors {', '.join(self.motors)} are not {n} different names.")
        if not np.all(np.abs(self.sign) == 1):
            raise ModelError("transmission: a sign must be 1 or -1.")
        rows = np.abs(self.matrix).max(axis=1, initial=0.0)
        if not (rows > 0).all() or np.linalg.cond(self.matrix / rows[:, None]) > WORST:
            raise ModelError(
                "transmission: its matrix has no inverse, so the torque of some motor cannot be determined."
            )

    def __repr__(self) -> str:
        return f"Transmission({', '.join(self.motors)})"

    @property
    def is_direct(self) -> bool:
        """Whether each motor drives its joint without a gear."""
        return bool(np.array_equal(self.matrix, np.eye(len(self.motors))))

    def with_motors(self, zero: Mapping[str, float], reversed_motors: Sequence[str]) -> Transmission:
        """A copy with the zeros of some motors replaced, and the signs of some set to -1.

        Raises: ModelError for an unknown motor.
        """
        for name in (*zero, *reversed_motors):
            if name not in self.motors:
                raise ModelError(f"'{name}' is not one of the motors {', '.join(self.motors)}.")
        return Transmission(
            self.motors, self.matrix,
            np.array([-1.0 if name in reversed_motors else s for name, s in zip(self.motors, self.sign, strict=True)]),
            np.array([zero.get(name, z) for name, z in zip(self.motors, self.zero, strict=True)]),
        )  # fmt: skip

    def motor_limits(self, limits: Sequence[tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """Limits of the motors before their zeros are subtracted, from those of the joints; {} if there are gears."""
        if not self.is_direct:
            return {}
        ends = zip(self.motors, self.sign, limits, strict=True)
        return {name: (low, high) if sign > 0 else (-high, -low) for name, sign, (low, high) in ends}

    def to_motors(self, joints: np.ndarray) -> np.ndarray:
        """Motor positions (n,) or (T, n) for these joint positions."""
        return np.linalg.solve(self.matrix, np.asarray(joints, float).T).T * self.sign + self.zero

    def to_joints(self, recording: Recording, joints: Sequence[str]) -> Recording:
        """Convert a recording of the motors, in their order, to the joints.

        A joint's sample is usable if the samples of all its motors are.
        """
        if self.is_direct and (self.sign == 1).all() and not self.zero.any():
            return recording.with_(joints=tuple(joints))
        linear = self.matrix * self.sign
        changes = {
            name: None if (values := getattr(recording, name)) is None else (values - zero) @ rows.T
            for name, rows, zero in (
                ("position", linear, self.zero), ("command", linear, self.zero), ("velocity", linear, 0.0),
                ("effort", np.linalg.inv(linear).T, 0.0),
            )
        }  # fmt: skip
        drives = linear != 0
        single = drives.sum(axis=1) == 1
        size = np.abs(linear)
        noise = np.where(single, size @ recording.noise, np.sqrt(size**2 @ recording.sigma**2))
        usable = ~(~recording.usable @ drives.T)
        return recording.with_(
            joints=tuple(joints),
            **changes,
            noise=noise,
            quantum=np.where(single, size @ recording.quantum, 0.0),
            usable=usable,
            gain=size @ recording.gain / size.sum(axis=1),
        )


def direct(joints: Sequence[str]) -> Transmission:
    """The transmission of a robot whose motors drive its joints directly."""
    n = len(joints)
    return Transmission(tuple(joints), np.eye(n), np.ones(n), np.zeros(n))
