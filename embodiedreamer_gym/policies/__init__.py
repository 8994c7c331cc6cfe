"""Policies: what one is, ACT, and how one is evaluated. They know observations and actions, nothing of physics."""

from __future__ import annotations

from embodiedreamer_gym.policies.evaluation import Evaluation, evaluate
from embodiedreamer_gym.policies.protocol import Policy, load_policy

__all__ = ["Evaluation", "Policy", "evaluate", "load_policy"]
