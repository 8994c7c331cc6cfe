"""The arms of a robot for key poses: joints, gripper, kinematics, and the mirror image of the other arm."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import ModelError, PolicyError
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.kinematics import Kinematics
from embodiedreamer_gym.robot.mirror import mirrored_joints

Array = np.ndarray


class Arms:
    """One arm, or two that mirror each other. All is computed for the first arm, which is at y > 0 if there are two.

    Raises: PolicyError for another number of arms, or an arm without gripper.
    """

    def __init__(self, model: RobotModel) -> None:
        try:
            signs = np.array(mirrored_joints(model)) if len(model.arms) == 2 else np.arange(1, model.n + 1)
        except ModelError as error:
            raise PolicyError(f"key poses need one arm, or two that mirror each other: {error}") from error
        if len(model.arms) not in (1, 2):
            raise PolicyError(
                f"key poses need one arm, or two that mirror each other; {model.name} has {len(model.arms)}."
            )
        self.model, self.two = model, len(model.arms) == 2
        self._of, self._sign = np.abs(signs) - 1, np.sign(signs)
        self.arm = Kinematics(model, model.arms[0])
        own = np.flatnonzero(model.tree.arm == model.tree.arm[self.arm.joints[0]])
        grippers = [int(j) for j in own if model.units[j] == "1"]
        if len(grippers) != 1:
            raise PolicyError(
                f"key poses need an arm with one gripper of unit 1; {model.name} has {len(grippers)} at one arm."
            )
        self.gripper = grippers[0]

    def mirrored(self, values: Array) -> Array:
        """Joints (..., n) of the mirror image."""
        return values[..., self._of] * self._sign

    def acting(self, states: Array) -> int:
        """The arm, 0 or 1, that moves most in states (T, n)."""
        if not self.two:
            return 0
        first, second = (np.abs(np.diff(x[:, self.arm.joints], axis=0)).sum() for x in (states, self.mirrored(states)))
        return int(second > first)
