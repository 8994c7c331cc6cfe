"""Figure of a proposed motion, to check it before it runs on hardware."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from embodiedreamer_gym.diagnosis.candidate_motions import blank
from embodiedreamer_gym.diagnosis.experiment_design import Proposal
from embodiedreamer_gym.diagnosis.report.drawing import AFTER, BAND, BEFORE, INK, WIDTH, short, tidy
from embodiedreamer_gym.robot.kinematics import Kinematics
from embodiedreamer_gym.simulation import simulate

COLUMNS = 3


def dry_run(proposal: Proposal) -> Figure:
    """Each joint's command within its limits, the difference of the two models, and the end effectors' paths."""
    model, n = proposal.models[0], len(proposal.joints)
    rows = int(np.ceil(n / COLUMNS))
    figure = Figure(figsize=(WIDTH, 1.5 * rows + 5.2), layout="constrained")
    parts = figure.subfigures(2, 1, height_ratios=(1.5 * rows, 5.2), squeeze=False)
    upper, lower = parts[0, 0], parts[1, 0]
    for j, axes in enumerate(upper.subplots(rows, COLUMNS, squeeze=False, sharex=True).flat):
        if j >= n:
            axes.set_visible(False)
            continue
        axes.axhspan(float(model.tree.lower[j]), float(model.tree.upper[j]), color=BAND, lw=0)
        axes.plot(proposal.time, proposal.command[:, j], color=INK, lw=1.0)
        axes.set_title(f"{short(proposal.joints[j])} [{model.units[j]}]", fontsize=8, loc="left")
        tidy(axes)
    left, right = lower.subplots(1, 2)
    _difference(proposal, left)
    _paths(proposal, right)
    figure.suptitle(f"{proposal.kind}: commands within the limits (band); least distance {1e3 * proposal.clearance:.0f} mm",
                    fontsize=10, color=INK)  # fmt: skip
    return figure


def _difference(proposal: Proposal, axes) -> None:
    """Root mean square difference of the two models over the joints, against time."""
    sigma = np.full(len(proposal.joints), 1.0)
    log = blank(proposal.models[0], proposal.kind, proposal.time, proposal.command, sigma)
    one, other = (simulate(model, log).position for model in proposal.models)
    axes.plot(proposal.time, 1e3 * np.sqrt(np.mean((one - other) ** 2, axis=1)), color=BEFORE, lw=1.2)
    axes.set_title(f"{proposal.effects[0]} against {proposal.effects[1]} [1e-3, rms of joints]", fontsize=8, loc="left")
    axes.set_xlabel("time [s]", fontsize=8)
    axes.set_ylim(bottom=0.0)
    tidy(axes)


def _paths(proposal: Proposal, axes) -> None:
    """Height of each end effector against its distance from the robot's root."""
    model = proposal.models[0]
    for k, tip in enumerate(model.tree.tips):
        chain = Kinematics(model, tip)
        places = np.array([chain.pose(command[chain.joints])[0] for command in proposal.command[::2]])
        axes.plot(
            np.hypot(places[:, 0], places[:, 1]), places[:, 2], color=(AFTER, BEFORE)[k % 2], lw=1.0, label=short(tip)
        )
    axes.set_title("end effectors, from the side [m]", fontsize=8, loc="left")
    axes.set_xlabel("distance from the root", fontsize=8)
    axes.set_ylabel("height", fontsize=8)
    axes.legend(frameon=False, fontsize=7)
    axes.set_aspect("equal", adjustable="datalim")
    tidy(axes)
