"""Starting points for refits: several sizes of an effect at nominal and calibrated gains; the best is chosen per joint.

The cost of a free run has several local minima in the size of an effect; one rollout per size finds the neighbourhood
of the deepest one.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.phys_aligner.problem import Problem, free_rows
from embodiedreamer_gym.phys_aligner.starts import best_choices, joint_of_rows
from embodiedreamer_gym.robot import ParameterKey, RobotModel

SIZES = (0.15, 0.4, 0.8, 1.5, 2.5, 4.0, 6.0)  # of a parameter that is off at zero, relative to its typical size
LIMITS = (0.6, 0.8, 1.0, 1.25, 1.6)  # of a limit, relative to its value in the screening
PAIR_SIZES = (0.2, 0.5, 1.0, 2.0, 3.5, 6.0)  # the same for each of two effects
PAIR_LIMITS = (0.6, 0.8, 1.0, 1.25, 1.6, 2.0)
Values = Mapping[ParameterKey, np.ndarray]


@dataclass(frozen=True, eq=False)
class Starts:
    """Starting values, group -> values: each of `first` is tried with each of `second`; the best is taken per joint.

    of_arm: whether `first` and `second` are values of an effect per arm, so that all joints of an arm take the same
    choice; apart: starts of which the best is fitted too, even if it is worse than the best of the others.
    """

    first: tuple[Values, ...]
    second: tuple[Values, ...] = ({},)
    of_arm: tuple[bool, bool] = (False, False)
    apart: tuple[Values, ...] = ()

    def all(self, problem: Problem) -> list[np.ndarray]:
        """The scaled starts (m,) from which a fit begins."""
        apart = [Starts(self.apart, of_arm=self.of_arm).best(problem)] if self.apart else []
        return [self.best(problem), *apart]

    def best(self, problem: Problem) -> np.ndarray:
        """Scaled start (m,); one rollout for each combination.

        Each joint is chosen on its own, because the coupling between joints matters less than a wrong size.
        """
        points = np.array([[start_of(problem, {**a, **b}) for b in self.second] for a in self.first])
        shape, model = points.shape, problem.model
        chi2 = problem.joint_rms(problem.residuals(points.reshape(-1, shape[2]))) ** 2
        one, other = best_choices(np.log1p(chi2).reshape(*shape[:2], -1), self.of_arm, model)
        joint = joint_of_rows(problem)
        return points[one[joint], other[joint], np.arange(shape[2])]


def single_starts(kind: type[Effect], model: RobotModel, start: Values, nominal: Values) -> Starts:
    """Starts for one more effect: the screening's values, and several sizes at the model's gains and at nominal gains.

    The calibrated gains have compensated for an effect of a whole arm, such as a payload: gains and inertia are too
    small by the same factor. Near these gains, every size of the effect has a larger error than no effect. The fit
    therefore also begins at nominal gains.

    nominal: nominal gains; empty if they are not tried.
    """
    gains = [{}, nominal] if nominal else [{}]
    sizes = _sizes(kind, model, start, LIMITS if is_limit(kind) else SIZES, alone=True)
    first = (start, *({**size, **gain} for gain in gains for size in sizes))
    apart = tuple({**size, **nominal} for size in sizes[:-1]) if nominal and is_of_arm(kind) else ()
    return Starts(first, of_arm=(is_of_arm(kind), False), apart=apart)


def pair_starts(
    kinds: Sequence[type[Effect]], model: RobotModel, start: Values, nominal: Values, fitted: Values | None = None
) -> Starts:  # fmt: skip
    """Starts for two effects: sizes of both, with the signs and shapes of `start`, at nominal gains.

    fitted: values of the first effect and gains from a fit with it alone, used as a further start.
    """
    grids = [[{**nominal, **size} for size in _sizes(k, model, start, PAIR_LIMITS if is_limit(k) else PAIR_SIZES)]
             for k in kinds]  # fmt: skip
    second = [{key: v for key, v in size.items() if key.effect} for size in grids[1]]
    first = grids[0] if fitted is None else [*grids[0], fitted]
    return Starts(tuple(first), tuple(second), (is_of_arm(kinds[0]), is_of_arm(kinds[1])))


def fitted_values(model: RobotModel) -> dict[ParameterKey, np.ndarray]:
    """Group -> values of a model's free parameters."""
    return {key: model.group_values(key) for key in dict.fromkeys(row.key.group for row in free_rows(model))}


def start_of(problem: Problem, start: Values) -> np.ndarray:
    """Scaled start (m,) of a problem: the values of `start` (group -> values) where given, else the model's own."""
    low, high = np.array([row.low for row in problem.rows]), np.array([row.high for row in problem.rows])
    values = np.array([start[r.key.group][r.index] if r.key.group in start else r.value for r in problem.rows])
    return np.clip(problem.scale(np.clip(values, low, high)), problem.lower, problem.upper)


def is_of_arm(kind: type[Effect]) -> bool:
    """Whether an effect has one set of values for all joints of an arm."""
    return all(p.per == "arm" for p in kind.parameters)


def is_limit(kind: type[Effect]) -> bool:
    """Whether an effect is off if its sizes are at their upper bounds."""
    return any(p.is_limit and not p.shape for p in kind.parameters)


def has_second_limit(kind: type[Effect]) -> bool:
    """Whether an effect has a second limit besides its size."""
    return any(p.is_limit and p.shape for p in kind.parameters)


def _sizes(
    kind: type[Effect], model: RobotModel, start: Values, factors: Sequence[float], alone: bool = False
) -> list[dict[ParameterKey, np.ndarray]]:
    """Parameters of an effect at several sizes and off; limits are relative to `start`, shapes are those of `start`.

    alone: whether to try both signs, and each size (and none) with several second limits; else signs and second limits
    are those of `start`.
    """
    two = alone and any(p.low < 0 and not p.shape for p in kind.parameters)
    bends = (1.0,)
    if alone and has_second_limit(kind):
        factors, bends = (*factors, np.inf if is_limit(kind) else 0.0), LIMITS
    choices = []
    for factor, bend, sign in itertools.product(factors, bends, (1.0, -1.0) if two else (1.0,)):
        values = {}
        for p in kind.parameters:
            key = ParameterKey(p.name, kind.name)
            low, high = model.parameter_bounds(p)
            typical = p.typical * high / p.high
            if p.is_limit:
                values[key] = np.clip((bend if p.shape else factor) * start[key], low, high)
            elif p.shape:
                values[key] = start[key]
            else:
                own = 1.0 if p.low >= 0 else sign if alone else np.where(start[key] < 0, -1.0, 1.0)
                values[key] = np.clip(own * factor * typical, low, high)
        choices.append(values)
    off = {
        ParameterKey(p.name, kind.name): model.parameter_off(p) for p in kind.parameters if p.is_limit or not p.shape
    }
    return [*choices, {**choices[0], **off}]  # off, for joints that do not reach the limit
