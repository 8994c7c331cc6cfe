"""Simulation of a proposed motion before it runs on a robot: the model's motion and its clearance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from embodiedreamer_gym.diagnosis.candidate_motions import COMMAND_HZ, blank
from embodiedreamer_gym.diagnosis.experiment_design import Proposal
from embodiedreamer_gym.engines.clearance import clearance
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from embodiedreamer_gym.workbench.player import Motion

CLEARANCE_HZ = 25.0


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A proposal with its commanded and simulated motion, and the clearance (K,) m along it at times (K,) s."""

    proposal: Proposal
    motion: Motion
    time: np.ndarray
    clearance: np.ndarray


def rehearse(model: RobotModel, proposal: Proposal, table: float | None) -> Rehearsal:
    """Simulate the proposed commands, and measure how close the robot's parts come to each other and to a table."""
    command, time = proposal.command, proposal.time
    log = blank(model, proposal.kind, time, command, np.ones(model.n))
    motion = Motion(proposal.kind, time, command, simulate(model, log).position, np.zeros(command.shape))
    rows = slice(None, None, round(COMMAND_HZ / CLEARANCE_HZ))
    return Rehearsal(proposal, motion, time[rows], clearance(model, command[rows], table))
