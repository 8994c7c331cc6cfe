"""Physical effects: one small file each, and the catalogue that lists them."""

from embodiedreamer_gym.effects.catalogue import CATALOGUE, find_effect, load_effects
from embodiedreamer_gym.effects.effect import (
    Effect,
    TorqueBudget,
    JointState,
    Mechanics,
    MechanicsChange,
    Parameter,
    SignalLaw,
)

__all__ = [
    "CATALOGUE",
    "Effect",
    "TorqueBudget",
    "JointState",
    "Mechanics",
    "MechanicsChange",
    "Parameter",
    "SignalLaw",
    "find_effect",
    "load_effects",
]
