"""Checks of the arguments of an environment; each error message lists what is allowed."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

import numpy as np

from embodiedreamer_gym.engines.engine import STEPS_PER_SECOND
from embodiedreamer_gym.errors import SimulationError, brief

Thing = TypeVar("Thing")


def check_choice(what: str, value: Any, allowed: Collection[Any]) -> Any:
    """Return a value that is one of those allowed.

    Raises: SimulationError that lists them.
    """
    if not isinstance(value, (str, type(None))) or value not in allowed:
        raise SimulationError(f"{what} {brief(value)} is not one of {', '.join(repr(a) for a in allowed)}.")
    return value


def check_flag(what: str, value: Any) -> bool:
    """Return a value that is True or False.

    Raises: SimulationError for anything else, such as "no", which Python counts as true.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise SimulationError(f"{what} {brief(value)} is neither True nor False.")
    return bool(value)


def check_mapping(what: str, value: Any) -> Mapping[str, Any]:
    """Return a mapping from names; None gives an empty one.

    Raises: SimulationError for anything else.
    """
    if value is not None and not isinstance(value, Mapping):
        raise SimulationError(f"{what} must be a dictionary, not {brief(value)}.")
    return value or {}


def check_size(what: str, size: Any) -> tuple[int, int]:
    """Return width and height of a picture.

    Raises: SimulationError for anything but two whole numbers from 8 to 4096.
    """
    whole = isinstance(size, (tuple, list)) and all(isinstance(x, (int, np.integer)) for x in size)
    width, height = size if whole and len(size) == 2 else (0, 0)
    if not (8 <= width <= 4096 and 8 <= height <= 4096):
        raise SimulationError(f"{what} {brief(size)} is not a width and height from 8 to 4096 pixels.")
    return int(width), int(height)


def choose(what: str, names: Any, known: Mapping[str, Thing]) -> dict[str, Thing]:
    """Return the entries of `known` with these names, one or several.

    Raises: SimulationError for an unknown name, with a list of the known ones, or for a name given twice.
    """
    if isinstance(names, (str, np.ndarray)) or not isinstance(names, Collection) or not names:
        names = (names,)
    names = [check_choice(what, name, known) for name in names]
    if len(set(names)) < len(names):
        raise SimulationError(f"{what} names must differ, not {brief(names)}.")
    return {name: known[name] for name in names}


def check_control_rate(hz: Any) -> int:
    """Return a control rate, Hz, whose period is a whole number of physics steps.

    Raises: SimulationError for any other rate.
    """
    if isinstance(hz, bool) or not isinstance(hz, int | float | np.integer) or hz not in STEPS_PER_SECOND:
        raise SimulationError(f"control_hz {brief(hz)} is not one of {', '.join(map(str, STEPS_PER_SECOND))}.")
    return int(hz)


def vector(what: str, values: Any, n: int) -> np.ndarray:
    """Return values as an array (n,) of float64; see `real_numbers`."""
    return real_numbers(what, values, (n,)).astype(float)


def real_numbers(what: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return values as an array of this shape, without changing their type.

    Raises: SimulationError for another shape, anything but real numbers, or numbers that are not finite.
    """
    try:
        array = np.asarray(values)
        real = array.dtype.kind in "biuf"
    except Exception:  # ragged lists, lists deeper than an array can be, or whatever an object's own conversion raises
        real, array = False, np.empty(0)
    count = math.prod(shape)
    if not real:
        raise SimulationError(f"{what} needs {count} real numbers, not {brief(values)}.")
    if array.shape != shape:
        raise SimulationError(f"{what} needs {count} numbers, shape {shape}, not shape {array.shape}.")
    if not np.isfinite(array).all():
        raise SimulationError(f"{what} contains a number that is not finite.")
    return array


def within(what: str, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return values (n,) that lie inside bounds (n,).

    Raises: SimulationError that names the first one outside.
    """
    for i in np.flatnonzero((values < low) | (values > high)):
        raise SimulationError(f"{what}[{i}] is {values[i]:g}, not within {low[i]:.4g} .. {high[i]:.4g}.")
    return values
