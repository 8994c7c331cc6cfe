"""The plant: one drive (servo + effects) shared by the batched free runs of the fits and by PyBullet."""

from embodiedreamer_gym.simulation.drive import TIME_STEP, Drive, Sets
from embodiedreamer_gym.simulation.inverse import inverse_sets, resting, run_sets
from embodiedreamer_gym.simulation.rollout import Rollout, simulate, simulate_sets

__all__ = ["TIME_STEP", "Drive", "Rollout", "Sets", "inverse_sets", "resting", "run_sets", "simulate", "simulate_sets"]
