"""The stand-in's bench, which replaces the real world to test policies without a real robot."""

from __future__ import annotations

from embodiedreamer_gym.io.deprecation import deprecated_names
from embodiedreamer_gym.standin.bench.engine import StandInWorld
from embodiedreamer_gym.standin.bench.env import make_stand_in
from embodiedreamer_gym.standin.bench.robot import logs

__all__ = ["StandInWorld", "logs", "make_stand_in"]
__getattr__ = deprecated_names(__name__, {"StandInEnv": "make_stand_in"})
