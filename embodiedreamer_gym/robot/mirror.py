"""Mirror images of the joints of a two-armed robot."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.kinematics import Kinematics
from embodiedreamer_gym.robot.model import RobotModel

ACCURACY = 1e-3  # m, rad: largest deviation between an arm and the other's mirror image
TRIALS = 8  # postures that are compared
PLANE = np.array([1.0, -1.0, 1.0])  # positions are mirrored in y = 0


def mirrored_joints(model: RobotModel) -> tuple[int, ...]:
    """Signed joint numbers (n,), counted from 1: joint i of a mirrored posture is sign times joint |number|.

    The plane is y = 0. Raises: ModelError for a robot without exactly two arms that mirror each other.
    """
    if len(model.arms) != 2:
        raise ModelError(f"{model.name} has {len(model.arms)} arms; only two can be each other's mirror image.")
    left, right = (Kinematics(model, tip) for tip in model.arms)
    own = [np.flatnonzero(model.tree.arm == model.tree.arm[arm.joints[0]]) for arm in (left, right)]
    wrong = ModelError(f"the arms of {model.name} are not each other's mirror image in the plane y = 0.")
    if len(left.joints) != len(right.joints) or len(own[0]) != len(own[1]) or 2 * len(own[0]) != model.n:
        raise wrong
    zero = np.zeros(len(left.joints))
    turns = [arm.jacobian(zero)[3:].T for arm in (left, right)]
    signs = np.where((turns[0] * -PLANE * turns[1]).sum(1) < 0.0, -1, 1)  # an axis is a pseudovector
    rng = np.random.default_rng(0)
    for angles in rng.uniform(-1.0, 1.0, (TRIALS, len(zero))):
        (at, turned), (seen, seen_turned) = left.pose(angles), right.pose(signs * angles)
        alike = PLANE[:, None] * turned[:, [2]] - seen_turned[:, [2]]  # where the grippers point
        if np.abs(at * PLANE - seen).max() > ACCURACY or np.abs(alike).max() > ACCURACY:
            raise wrong
    of = dict(zip(left.joints.tolist(), signs.tolist(), strict=True))
    numbers = np.zeros(model.n, int)
    for mine, other in zip(*own, strict=True):
        sign = of.get(int(mine), 1)  # grippers open in the same direction
        numbers[mine], numbers[other] = sign * (other + 1), sign * (mine + 1)
    return tuple(numbers.tolist())
