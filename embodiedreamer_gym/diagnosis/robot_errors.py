"""Fits with nuisance parameters, the robot's own errors: masses, centres of mass, viscous friction, timing of commands.

A calibration takes these values from the model, so its residuals do not show how they change its parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from embodiedreamer_gym.diagnosis.null_distribution import CENTRE, GROUPS, MASS, VISCOUS, VISCOUS_FRICTION
from embodiedreamer_gym.effects.command_timing import CommandTiming
from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.phys_aligner.least_squares import Fit, minimise
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.robot.data import UrdfError

ITERATIONS, TOLERANCE = 6, 1e-4
FINE, COARSE, SECANT = 1e-5, 1e-4, 1e-2  # steps of the last derivatives, scaled units
JUMPS = 0.2  # relative change of a derivative from a coarse step to a fine one above which a law jumps


def fit_with_robot_errors(
    problem: Problem, x: np.ndarray, recordings: Sequence[Recording], derivatives: bool = True
) -> tuple[Problem, Fit]:  # fmt: skip
    """Continue a fit from scaled parameters (m,) on other recordings, with nuisance parameters of the robot.

    Priors hold them near zero error. Viscous friction is one of them although a servo's damping has the same effect: if
    a drive is at its limit, damping is cut off and friction is not, and a fit with the wrong friction has an error in
    everything in units of torque. The same happens if commands act half a tick earlier than positions: the part that
    damping cannot compensate is then attributed to inertia. Masses and friction that the problem already fits stay as
    they are.
    derivatives: whether the Jacobian at the end is needed, see `minimise`.
    """
    wider = _problem(problem, problem.model_at(x), recordings)
    fit = minimise(wider, wider.start, ITERATIONS, TOLERANCE, derivatives=False)
    return wider, _with_derivatives(wider, fit) if derivatives else fit


def _with_derivatives(problem: Problem, fit: Fit) -> Fit:
    """The fit with derivatives over finer steps, and with the parameters marked whose derivatives depend on the step.

    The error of a finite difference grows with the curvature. In a direction that residuals do not determine, such as
    masses and torques that grow in the same proportion, it is larger than the prior's share and makes the direction
    seem determined. A law that jumps, as backlash does, has no derivative (or zero), so the slope over a step as long
    as the parameter's uncertainty is used.
    """
    fine = problem.jacobian(fit.x, FINE, anew=True)[1]
    coarse = problem.jacobian(fit.x, COARSE, only=~problem.of_urdf)[1]
    change, size = (np.linalg.norm(j, axis=0) for j in (fine - coarse, fine))
    jumps = (change > JUMPS * size) | ((size == 0) & ~problem.of_urdf)
    if jumps.any():
        fine[:, jumps] = problem.jacobian(fit.x, SECANT, only=jumps)[1][:, jumps]
    return replace(fit, jacobian=fine, jumps=jumps)


def _problem(problem: Problem, model: RobotModel, recordings: Sequence[Recording]) -> Problem:
    """The problem's parameters at a model's values, and the nuisance parameters.

    Masses and centres that the model holds fixed start at their values, but are known no better than those of a
    faultless robot, because an estimate from an earlier test has an error too.
    """
    groups = list(dict.fromkeys(row.key.group for row in problem.rows))
    known = not set(GROUPS) <= set(groups)
    if not model.has_effect(InertialError):
        model = model.with_(urdf_error=UrdfError(mass=MASS, centre=CENTRE)).with_effect(InertialError)
    groups += GROUPS if known else ()
    if all(recording.command is not None for recording in recordings):
        model = model.with_effect(CommandTiming)
        groups.append(ParameterKey("seconds", CommandTiming.name))
    friction = VISCOUS_FRICTION not in groups
    wider = Problem(model, recordings, [*groups, VISCOUS_FRICTION] if friction else groups, problem.hold)
    keys = [row.key.group for row in wider.rows]
    if friction:
        _hold_near(wider, np.array([key == VISCOUS_FRICTION for key in keys]), VISCOUS)
    if known:
        sizes = {
            key: MASS / model.urdf_error.mass if key == GROUPS[0] else CENTRE / model.urdf_error.centre
            for key in GROUPS
        }
        for key, sd in sizes.items():
            _hold_near(wider, np.array([one == key for one in keys]), sd)
    if model.fixed:
        fixed = {row.name for row in model.parameters().select(*model.fixed).rows if row.key.group not in GROUPS}
        held = np.array([row.name in fixed for row in wider.rows])
        wider.lower[held] = wider.upper[held] = wider.start[held]
    return wider


def _hold_near(problem: Problem, rows: np.ndarray, sd: float) -> None:
    """Give parameters (m,) bool a prior around their start, with a standard deviation in scaled units."""
    problem.centre[rows], problem.prior[rows] = problem.start[rows], sd**-2
