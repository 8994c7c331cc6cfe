"""Training of networks: optimisation with a learning rate schedule, running average and checkpoints."""

from __future__ import annotations

from embodiedreamer_gym.learning.checkpoint import read_state, write_state
from embodiedreamer_gym.learning.epochs import run_epochs
from embodiedreamer_gym.learning.optimisation import Optimisation, cosine
from embodiedreamer_gym.learning.training import Training, TrainingSettings, train_in_folder

__all__ = [
    "Optimisation",
    "Training",
    "TrainingSettings",
    "cosine",
    "read_state",
    "run_epochs",
    "train_in_folder",
    "write_state",
]
