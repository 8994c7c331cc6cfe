"""Realistic video from simulated frames: conditions, models, training and measures."""

from __future__ import annotations

from embodiedreamer_gym.io.deprecation import deprecated_names
from embodiedreamer_gym.vis_aligner.aligner import Aligner, generate
from embodiedreamer_gym.vis_aligner.bank import Bank, make_bank
from embodiedreamer_gym.vis_aligner.bank_files import save_bank
from embodiedreamer_gym.vis_aligner.checkpoint import load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.clip import Episode, References
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.episodes import load_episode, load_episodes

__all__ = [
    "Aligner",
    "Bank",
    "Condition",
    "Episode",
    "References",
    "generate",
    "load_aligner",
    "load_bank",
    "load_episode",
    "load_episodes",
    "make_bank",
    "save_bank",
]

__getattr__ = deprecated_names(__name__, {"dream": "generate", "measures": "embodiedreamer_gym.vis_aligner.metrics"})
