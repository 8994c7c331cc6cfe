"""Detect motors that drive two joints each: the effort error of a joint then follows the friction of another joint.

If each motor drives one joint, the dry friction of a joint never appears in the torque of another, whatever the masses
are. If motors are coupled, as in many wrists, it does in logs that contain motor currents and joint positions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.effort_terms import motion_terms
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

LEAST = 2.0  # chi2 of a joint's error above which the joint is examined
SHARE = 0.4  # share of a joint's held-out mean square error that the friction of another joint must predict


def coupled_joints(
    model: RobotModel, train: Sequence[Recording], test: Sequence[Recording]
) -> list[tuple[float, str, str]]:
    """Joints whose effort error follows another joint's friction: (predicted share of held-out error, joint, other).

    The prediction is a least-squares fit on the other joint's speed and its sign, in addition to the joint's own
    torque, acceleration, speed, sign of the speed and a constant.
    """
    learn, judge = (_tables(model, part) for part in (train, test))
    coupled: list[tuple[float, str, str]] = []
    for j, (old, new) in enumerate(zip(learn, judge, strict=True)):
        columns = 1 + np.arange(4 * model.n).reshape(4, model.n)  # torque, acceleration, speed, its sign
        own = [*columns[:, j].tolist(), -1]
        if len(old) < 10 * len(own) or not len(new):
            continue
        alone = _held_out(old, new, own)
        others = np.delete(np.arange(model.n), j).tolist()
        if alone <= LEAST or not others:
            continue
        left = [_held_out(old, new, [*own, *columns[2:, k].tolist()]) for k in others]
        share = 1.0 - min(left) / alone
        if share >= SHARE:
            coupled.append((share, model.joints[j], model.joints[others[int(np.argmin(left))]]))
    return coupled


def coupling_notes(model: RobotModel, train: Sequence[Recording], test: Sequence[Recording]) -> tuple[str, ...]:
    """A sentence for each joint found by `coupled_joints`."""
    return tuple(
        f"Note: {share:.0%} of the unexplained effort of {joint} follows the friction of {other}, as if one motor drove both "
        "joints; if these are currents of coupled motors, state the model's `transmission`."
        for share, joint, other in coupled_joints(model, train, test)
    )


def _tables(model: RobotModel, recordings: Sequence[Recording]) -> list[np.ndarray]:
    """Table (N, 2 + 4 n) of each joint: its error in units of sensor noise; regressors of all joints; a constant.

    The regressors are torque, acceleration, speed and sign of the speed.
    """
    compared = Signals(model, recordings)
    runs = compared.runs(model)
    errors = compared.errors(runs)
    joints: list[list[np.ndarray]] = [[] for _ in model.joints]
    for recording, run, error, usable in zip(compared.recordings, runs, errors, compared.usable, strict=True):
        terms = np.hstack([run.torque[0], *motion_terms(recording), np.ones((len(usable), 1))])
        for j, rows in enumerate(joints):
            rows.append(np.column_stack([error[0][:, j] / compared.sigma[j], terms])[usable[:, j]])
    return [np.concatenate(rows) for rows in joints]


def _held_out(old: np.ndarray, new: np.ndarray, columns: list[int]) -> float:
    """Mean square error on held-out rows of a least-squares fit on some columns."""
    size = np.maximum(np.abs(old[:, columns]).max(axis=0), 1e-300)
    weights = np.linalg.lstsq(old[:, columns] / size, old[:, 0], rcond=None)[0] / size
    return float(np.mean((new[:, 0] - new[:, columns] @ weights) ** 2))
