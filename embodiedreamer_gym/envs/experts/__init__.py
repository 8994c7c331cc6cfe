"""Scripted experts that perform the tasks with the environment's actions alone."""

from __future__ import annotations

from embodiedreamer_gym.envs.experts.scripted import ScriptedExpert

__all__ = ["ScriptedExpert"]
