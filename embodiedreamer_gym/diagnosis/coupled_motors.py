"""Motors that drive two joints each: the error of a joint's effort follows the friction of another joint.

No mechanics puts the dry friction of one joint into the torque of another, whatever the masses are. Coupled motors do, as in
many wrists, when a log shows their currents beside the positions of the joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from embodiedreamer_gym.phys_aligner.effort_terms import motion_terms
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

LEAST = 2.0  # chi2 of a joint's error, from which it is looked at
SHARE = 0.4  # of a joint's held-out mean square error, that another joint's friction must predict to be named


def coupled_joints(
    model: RobotModel, train: Sequence[Recording], test: Sequence[Recording]
) -> list[tuple[float, str, str]]:
    """Joints whose effort error follows another's friction: the share of the error that it predicts (held out), the joint, the other.

    By least squares on the other's speed and its sign, beside the joint's own torque, acceleration, speed, sign and one.
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
    """A sentence for each joint of `coupled_joints`."""
    return tuple(
        f"Note: {share:.0%} of the unexplained effort of {joint} follows the friction of {other}, as if one motor drove both "
        "joints; if these are currents of coupled motors, state the model's `transmission`."
        for share, joint, other in coupled_joints(model, train, test)
    )


def _tables(model: RobotModel, recordings: Sequence[Recording]) -> list[np.ndarray]:
    """Of each joint (N, 2 + 4 n): its error in sensor noises; torque, acceleration, speed and its sign of all joints; one."""
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
    """Mean square error on held-out rows of least squares on some columns."""
    size = np.maximum(np.abs(old[:, columns]).max(axis=0), 1e-300)
    weights = np.linalg.lstsq(old[:, columns] / size, old[:, 0], rcond=None)[0] / size
    return float(np.mean((new[:, 0] - new[:, columns] @ weights) ** 2))
