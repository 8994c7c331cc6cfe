"""Physical effects: one small file for each, and the catalogue that lists them."""

from embodiedreamer_gym.effects.catalogue import CATALOGUE, NUISANCES, find_effect, load_effects
from embodiedreamer_gym.effects.effect import (
    Effect,
    JointState,
    Mechanics,
    MechanicsChange,
    Parameter,
    ServoState,
    SignalLaw,
    TorqueBudget,
)

__all__ = [
    "CATALOGUE",
    "NUISANCES",
    "Effect",
    "JointState",
    "Mechanics",
    "MechanicsChange",
    "Parameter",
    "ServoState",
    "SignalLaw",
    "TorqueBudget",
    "find_effect",
    "load_effects",
]
