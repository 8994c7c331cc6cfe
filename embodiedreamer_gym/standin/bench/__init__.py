"""The stand-in's bench: the real world, in which policies are tried without a real robot."""

from __future__ import annotations

from embodiedreamer_gym.standin.bench.env import StandInEnv
from embodiedreamer_gym.standin.bench.robot import logs

__all__ = ["StandInEnv", "logs"]
