"""Timestamp jitter: what it takes off a free run's error, and what it cannot take off."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects.command_delay import CommandDelay
from embodiedreamer_gym.effects.laws import check_laws
from embodiedreamer_gym.effects.timestamp_jitter import TimestampJitter
from embodiedreamer_gym.errors import EffectError
from embodiedreamer_gym.phys_aligner.signals import Signals
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from tests.bank import fast, robot
from tests.two_joint_arm import load_arm, record

SD, NOISE = 0.002, 3e-4
GROUP = "timestamp_jitter.seconds"


@pytest.fixture
def arm(tmp_path) -> RobotModel:
    """The arm with the effect, which is off."""
    return load_arm(tmp_path).with_effect("timestamp_jitter")


def jittered(log: Recording, sd: float = SD) -> tuple[Recording, np.ndarray]:
    """The log under stamps that are late by (T,) s."""
    late = np.clip(sd * np.random.default_rng(5).standard_normal(len(log.time)), -0.0045, 0.0045)
    return log.with_(time=log.time + late), late


def chi2(model: RobotModel, log: Recording, seconds: np.ndarray) -> np.ndarray:
    """Mean square residual (P,) under jitters (P,)."""
    r = Signals(model, [log]).residuals(model, {GROUP: seconds[:, None]})
    return np.mean(r**2, axis=1)


def test_the_error_is_least_at_the_clocks_own_jitter(arm: RobotModel) -> None:
    log, late = jittered(record(arm, noise=NOISE))
    tried = np.linspace(0.0, 2.0, 41) * np.std(late)
    found = chi2(arm, log, tried)
    assert found[0] > 3.0
    assert found.min() < 1.0 + 0.1 * (found[0] - 1.0)
    assert tried[np.argmin(found)] == pytest.approx(np.std(late), rel=0.1)


def test_a_late_stamp_is_mended_the_right_way(arm: RobotModel) -> None:
    """Without noise: what the log's clock would have stamped is what was logged."""
    log, late = jittered(record(arm))
    signals = Signals(arm, [log])
    off, on = (signals.errors(signals.runs(arm, {GROUP: np.array([[s]])}))[0][0] for s in (0.0, np.std(late)))
    moving = log.time > 1.5
    assert np.all(np.std(on[moving], axis=0) < 0.3 * np.std(off[moving], axis=0))


def test_off_it_is_absent(arm: RobotModel) -> None:
    log, _ = jittered(record(arm, noise=NOISE))
    bare = arm.with_(effects=())
    a, b = (Signals(m, [log]).residuals(m) for m in (arm, bare))
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("delay", [0.0, 0.03])
def test_it_has_no_part_in_a_log_with_a_good_clock(delay: float, arm: RobotModel) -> None:
    """However large, it takes nothing off the error: not off a delay's either."""
    robot = arm.with_effect(CommandDelay(seconds=dict.fromkeys(arm.joints, delay)))
    log = record(robot, noise=NOISE)
    found = chi2(arm, log, np.array([0.0, 0.003, 0.02]))
    np.testing.assert_allclose(found, found[0], rtol=0.02)
    assert (found[0] > 10.0) == (delay > 0)


def test_it_leaves_a_delay_alone_where_there_is_jitter(arm: RobotModel) -> None:
    """What the jitter's model takes off is the jitter's share of the error, and the delay's stays."""
    robot = arm.with_effect(CommandDelay(seconds=dict.fromkeys(arm.joints, 0.03)))
    clean = record(robot, noise=NOISE)
    log, _ = jittered(clean)
    delayed = chi2(arm, clean, np.zeros(1))[0]
    found = chi2(arm, log, np.linspace(0.0, 0.02, 81))
    assert found.min() > 0.95 * delayed


def test_each_arm_has_its_own_clock() -> None:
    model = robot("aloha").with_effect("timestamp_jitter")
    log = fast(model, 2.0)
    run = simulate(model, log)
    rng = np.random.default_rng(0)
    late = np.clip(0.003 * rng.standard_normal(len(log.time)), -0.004, 0.004)[:, None] * (model.tree.arm == 1)
    position = run.position - run.velocity * late + 1e-4 * rng.standard_normal(run.position.shape)
    seen = log.with_(position=position, noise=np.full(model.n, 1e-4))
    signals = Signals(model, [seen])
    plain, both = signals.runs(model)[0].position, signals.runs(model, {GROUP: np.full((1, 2), 0.003)})[0].position
    moved = np.abs(both - plain).max(axis=(0, 1)) > 0
    np.testing.assert_array_equal(moved, model.tree.arm == 1)
    before, after = (np.std((seen.position - x[0])[:, moved]) for x in (plain, both))
    assert after < 0.8 * before


def test_it_plays_no_part_where_no_log_holds_a_command(arm: RobotModel) -> None:
    log, _ = jittered(record(arm, noise=NOISE))
    inverse = log.with_(command=None, effort_unit="N m")
    r = Signals(arm, [inverse]).residuals(arm, {GROUP: np.array([[0.0], [0.02]])})
    np.testing.assert_array_equal(r[0], r[1])
    assert Signals(arm, [inverse]).visible(TimestampJitter, 1.0, np.ones(2)) == 0.0


def test_a_clocks_law_takes_one_value_an_arm() -> None:
    class Loud(TimestampJitter):
        """One of the joints."""

        @staticmethod
        def law(signal, joint, memory, p):
            return np.hypot(joint.position, p.seconds[:, :1]), memory

    class Early(TimestampJitter):
        """One of the command."""

        stage = "command"

    check_laws(TimestampJitter)
    with pytest.raises(EffectError, match=r"shape \(7, 3\) for a signal \(7, 2\)"):
        check_laws(Loud)
    with pytest.raises(EffectError, match="per arm; on the stage 'command' values are per joint"):
        check_laws(Early)
