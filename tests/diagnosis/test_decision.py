"""The proposed motion decides as clearly as it was expected to."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.candidate_motions import CandidateMotion
from embodiedreamer_gym.diagnosis.decision import decide, likelihood_ratio
from embodiedreamer_gym.diagnosis.expected_likelihood import simulated
from embodiedreamer_gym.diagnosis.experiment_design import NOISE, propose_motion
from embodiedreamer_gym.diagnosis.held_out import HeldOut
from tests.bank import robot

PAIR = ("command_delay", "command_lowpass")


def taken(proposal, model, seed):
    """The proposed motion as a robot like the model makes it, with noise."""
    motion = CandidateMotion(proposal.kind, proposal.time, proposal.command, proposal.clearance)
    (log,) = simulated(model, [motion], np.full(model.n, NOISE))
    noise = NOISE * np.random.default_rng(seed).standard_normal(log.position.shape)
    return log.with_(position=log.position + noise, name=f"take-{seed}")


@pytest.fixture(scope="module")
def proposal():
    return propose_motion(robot("pendulum1"), PAIR, seconds=4.0, acceleration=20.0)


def test_a_delay_is_told_from_a_lowpass_as_clearly_as_expected(proposal) -> None:
    assert proposal.kind in ("reversals", "bang_bang", "chirp") and proposal.decides
    truth = proposal.models[0]
    (hidden,) = (effect.name for effect in truth.effects)
    found = decide(robot("pendulum1"), PAIR, [taken(proposal, truth, 1)], [taken(proposal, truth, 2)])
    assert found.best == hidden == found.effects[0]
    assert 0.5 < found.ratio.value / proposal.log_likelihood < 2.0
    assert f"it is {hidden}" in str(found) and found.as_dict()["ratio"]["value"] == found.ratio.value


def test_a_faultless_robot_shows_neither(proposal) -> None:
    model = robot("pendulum1")
    found = decide(model, PAIR, [taken(proposal, model, 1)], [taken(proposal, model, 2)])
    assert found.best is None and "neither" in str(found)


@pytest.mark.parametrize(
    ("apart", "decides"), [(np.full(24, 1.0), True), (np.zeros(24), False), (np.eye(24)[0] * 24, False)]
)
def test_one_odd_piece_of_time_decides_nothing(apart, decides) -> None:
    counts = np.full((24, 1), 20)
    one, other = (HeldOut(blocks.sum(0) / 480, np.ones(1), blocks, counts)
                  for blocks in (np.full((24, 1), 20.0), 20.0 + apart[:, None]))  # fmt: skip
    ratio = likelihood_ratio(one, other, 1.0)
    assert ratio.value == pytest.approx(apart.sum()) and ratio.decides == decides
    assert likelihood_ratio(other, one, 1.0).value == pytest.approx(-apart.sum())
