"""Policies: their interface, ACT, and their evaluation. They depend on observations and actions, not on physics."""

from __future__ import annotations

from embodiedreamer_gym.policies.evaluation import Evaluation, evaluate
from embodiedreamer_gym.policies.protocol import Policy, load_policy

__all__ = ["Evaluation", "Policy", "evaluate", "load_policy"]
