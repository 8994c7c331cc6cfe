"""Physical effects: one small file each, and the catalogue that lists them."""

from embodiedreamer_gym.effects.catalogue import CATALOGUE, find_effect, load_effects
from embodiedreamer_gym.effects.effect import (
    Effect,
    JointState,
    Mechanics,
    MechanicsChange,
    Parameter,
    SignalLaw,
    TorqueBudget,
)

__all__ = [
    "CATALOGUE",
    "Effect",
    "JointState",
    "Mechanics",
    "MechanicsChange",
    "Parameter",
    "SignalLaw",
    "TorqueBudget",
    "find_effect",
    "load_effects",
]
