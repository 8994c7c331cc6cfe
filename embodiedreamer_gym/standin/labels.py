"""Choices for blind cases: the effects in question, their families and strengths, and how the arm is recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.standin.cases import Case, draw_case
from embodiedreamer_gym.standin.effect_sizes import FIRMWARE, SIZES, SUPPLY

BARELY, PLAIN, STRONG = 0.15, 1.0, 2.5  # strengths; 1.0 is a plain effect
ATTEMPTS = 5  # most robots drawn until one rests at its first command

# With a logged command, the fitted gains absorb a torque constant completely; only effort without a command shows it.
# Firmware effects have their own benchmark; supply sag is in no set of cases.
APART = (*FIRMWARE, *SUPPLY)
SINGLES = tuple(name for name in SIZES if name != "torque_constant" and name not in APART)
# Effects that other effects in the catalogue contain: without its own entry, such an effect is still in the catalogue.
# Direction-dependent friction is Coulomb friction and a bias.
CONTAINED = ("direction_dependent_friction", "coulomb_friction", "torque_saturation", "torque_bias", "torque_constant")
OUTSIDE = tuple(name for name in SIZES if name not in (*CONTAINED, *APART))
IN_EFFORT = ("payload", "coulomb_friction", "stribeck_friction", "load_friction", "direction_dependent_friction",
             "torque_constant", "torque_bias", "rotor_inertia")  # fmt: skip
PERIODIC = {("torque_ripple", "phase")}  # parameters that an interval on the real line does not describe
FAMILIES = {
    "command": ("command_delay", "command_lowpass", "command_rate_limit"),
    "drive": ("servo_deadzone", "torque_saturation", "voltage_limit", "torque_constant", "torque_fade", *SUPPLY),
    "friction": ("coulomb_friction", "stribeck_friction", "load_friction", "direction_dependent_friction",
                 "hysteresis", "quadratic_drag"),
    "load": ("torque_bias", "joint_spring", "payload", "base_tilt", "encoder_offset", "torque_ripple"),
    "gear": ("joint_elasticity", "backlash", "rotor_inertia"),
    "log": ("timestamp_jitter",),
    "firmware": FIRMWARE,
}  # fmt: skip
AS_A_PERSON: dict[str, Any] = {"learnt": ("teleoperation",) * 2, "held_out": ("teleoperation",) * 2, "hz": 30.0}


def draw_strength(rng: np.random.Generator, low: float, high: float = STRONG) -> float:
    """A strength, drawn log-uniformly."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def family_of(effect: str) -> str:
    """The family of an effect; its own name if it has none."""
    return next((family for family, names in FAMILIES.items() if effect in names), effect)


def partners(effect: str) -> list[str]:
    """Effects of other families that are not confused with this one."""
    family = FAMILIES[family_of(effect)]
    confused = {other for other in SINGLES if other in CATALOGUE[effect].confused_with}
    confused |= {other for other in SINGLES if effect in CATALOGUE[other].confused_with}
    return [other for other in SINGLES if other not in family and other not in confused]


def draw_at_rest(
    effects: Sequence[str], arm: str, rng: np.random.Generator, strength: float, **recording: Any
) -> Case:  # fmt: skip
    """`draw_case`, repeated if the arm does not come to rest, e.g. with too much friction.

    Raises: SimulationError where none of ATTEMPTS robots comes to rest.
    """
    for _ in range(ATTEMPTS - 1):
        with suppress(SimulationError):
            return draw_case(effects, arm, rng, strength, **recording)
    return draw_case(effects, arm, rng, strength, **recording)


def places(hidden: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, list[str]]:
    """Joints or end effectors on which each hidden effect acts."""
    return {name: sorted({at for row in values.values() for at in row}) for name, values in hidden.items()}
