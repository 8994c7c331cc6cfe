from dataclasses import replace

import numpy as np
import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.motions import MOTIONS
from embodiedreamer_gym.standin.arms import arm_urdf
from embodiedreamer_gym.standin.span import span_of

SMOOTH = [name for name in MOTIONS if name != "staircase"]


@pytest.mark.parametrize("kind", MOTIONS)
def test_stays_in_reach(kind, span):
    room = span()
    motion = MOTIONS[kind](room, np.random.default_rng(1))
    path = motion(np.arange(0, motion.duration, 2e-3))
    assert np.all(np.abs(path - room.centre) <= room.reach + 1e-9)
    assert motion.kind == kind
    assert np.ptp(path, axis=0).max() > 0.02


@pytest.mark.parametrize("kind", SMOOTH)
def test_keeps_the_speed_and_never_jumps(kind, span):
    room = span()
    motion = MOTIONS[kind](room, np.random.default_rng(2))
    step = 1e-3
    speed = np.diff(motion(np.arange(0, motion.duration, step)), axis=0) / step
    assert np.all(np.abs(speed) <= room.speed * 1.01)


@pytest.mark.parametrize("kind", ["reversals", "bang_bang", "chirp"])
@pytest.mark.parametrize("pace", [0.08, 1.0])
def test_quick_motions_keep_the_acceleration_and_rest_at_the_centre(kind, pace, span):
    room = replace(span(), speed=pace * span().speed, acceleration=5.0)
    motion, step = MOTIONS[kind](room, np.random.default_rng(2), 8.0), 1e-3
    path = motion(np.arange(0, motion.duration + step / 2, step))
    rates = np.diff(path, axis=0) / step
    assert np.abs(np.diff(rates, axis=0)).max() / step <= 5.0 * 1.02
    assert np.all(np.abs(rates) <= room.speed * 1.01)
    assert motion.at_rest and np.abs(rates[[0, -1]]).max() < 0.01
    np.testing.assert_allclose(path[[0, -1]], [room.centre] * 2, atol=1e-9)


def test_reversals_have_eight_sizes_and_bang_bang_is_at_the_limit(span):
    room, step = span(), 1e-3
    times = np.arange(0, 8.0, step)
    path = MOTIONS["reversals"](room, np.random.default_rng(1), 8.0)(times)[:, 0] - room.centre[0]
    turns = np.abs(path[1:-1][np.diff(np.sign(np.diff(path))) != 0])
    turns = turns[turns > 1e-3]  # without the rest at the end
    assert len(np.unique(turns.round(4))) == 8 and turns.max() > 10 * turns.min()
    path = MOTIONS["bang_bang"](room, np.random.default_rng(1), 8.0)(times)
    force = np.abs(np.diff(path, 2, axis=0)) / step**2
    assert np.mean(force > 0.99 * room.acceleration) > 0.4


@pytest.mark.parametrize("kind", MOTIONS)
def test_one_time_or_many_and_constant_outside(kind, span):
    motion = MOTIONS[kind](span(), np.random.default_rng(3))
    times = np.array([-1.0, 0.0, 0.77, 2.0, motion.duration, motion.duration + 5])
    many = motion(times)
    assert many.shape == (6, 6)
    np.testing.assert_array_equal(many, [motion(t) for t in times])
    np.testing.assert_array_equal(many[0], many[1])
    np.testing.assert_array_equal(many[4], many[5])


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_seed_gives_one_motion(kind, span):
    times = np.linspace(0, 4, 50)
    first, again, other = (MOTIONS[kind](span(), np.random.default_rng(seed))(times) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_multisine_is_band_limited_and_rests_at_both_ends(span):
    motion = MOTIONS["multisine"](span(), np.random.default_rng(6), duration=20.0, lowest=0.5, highest=1.5)
    path = motion(np.arange(0, 20, 0.01)) - span().centre
    power = np.abs(np.fft.rfft(path, axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(path), 0.01)
    inside = (frequency > 0.4) & (frequency < 1.6)
    assert power[inside].sum() / power.sum() > 0.99
    np.testing.assert_allclose(motion(np.array([0.0, 20.0])), [span().centre] * 2, atol=1e-9)


def test_slow_ramps_go_both_ways_at_one_speed(span):
    motion = MOTIONS["slow_ramps"](span(), np.random.default_rng(7), duration=8.0)
    speed = np.diff(motion(np.arange(0, 8, 0.01)), axis=0) / 0.01
    assert np.all(np.abs(np.median(np.abs(speed), axis=0) - np.abs(speed).max(0)) < 1e-6)
    assert np.all((speed > 0).any(0) & (speed < 0).any(0))


def test_teleoperation_pauses_and_hold_poses_hold(span):
    for kind, still in (("teleoperation", 0.05), ("hold_poses", 0.4)):
        motion = MOTIONS[kind](span(), np.random.default_rng(8), duration=20.0)
        speed = np.abs(np.diff(motion(np.arange(0, 20, 0.01)), axis=0)).max(1)
        assert np.mean(speed < 1e-9) > still


def test_a_joint_without_limits_is_refused():
    with pytest.raises(ModelError, match="joint 'elbow' no limits"):
        span_of(arm_urdf("arm6"), ["elbow"])
