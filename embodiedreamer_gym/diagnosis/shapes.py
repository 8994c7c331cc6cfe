"""Shapes in a fit: scan them if the fit may have ended with a wrong one, such as a ripple of another frequency."""

from __future__ import annotations

import itertools

import numpy as np

from embodiedreamer_gym.diagnosis.effect_starts import Starts, fitted_values
from embodiedreamer_gym.effects import Parameter
from embodiedreamer_gym.phys_aligner.problem import Problem
from embodiedreamer_gym.robot import ParameterKey, RobotModel

SIZES = (0.3, 1.0)  # of a size, relative to its typical value
SHAPES = (0.3, 1.0, 3.0)  # of a shape, the same
SIGNED = (-0.75, -0.3, -0.1, 0.0, 0.1, 0.3, 0.75)  # of a shape that has a sign, relative to its bound


def shape_starts(problem: Problem, x: np.ndarray, stuck: np.ndarray) -> Starts | None:
    """Starts at the parameters x (m,) of a fit, with each joint effect's shapes at many values; None without shapes.

    Each shape has its own local minimum, and only what the other effects leave shows which one is the deepest.
    stuck (n,) bool: joints whose shapes are changed; changes on the others would disturb them.
    """
    model = problem.model_at(x)
    fitted = fitted_values(model)
    tried = []
    for effect in model.effects:
        keys = [ParameterKey(p.name, effect.name) for p in effect.parameters]
        shaped = any(p.shape and not p.is_limit and p.per == "joint" for p in effect.parameters)
        if not shaped or not fitted.keys() >= set(keys):  # a fixed effect is not fitted
            continue
        choices = [_choices(model, p, model.group_values(key)) for key, p in zip(keys, effect.parameters, strict=True)]
        for row in itertools.product(*choices):
            tried.append({**fitted, **{k: np.where(stuck, v, fitted[k]) for k, v in zip(keys, row, strict=True)}})
    return Starts((fitted, *tried)) if tried else None


def _choices(model: RobotModel, p: Parameter, own: np.ndarray) -> list[np.ndarray]:
    """Values (n,) of a parameter that are tried; own: the fitted values, which a limit keeps."""
    if p.is_limit:
        return [own]
    low, high = model.parameter_bounds(p)
    if p.starts:
        return [np.full_like(low, v) for v in p.starts]
    if p.shape and p.low < 0:
        return [factor * high for factor in SIGNED]
    return [np.clip(factor * p.typical * high / p.high, low, high) for factor in (SHAPES if p.shape else SIZES)]
