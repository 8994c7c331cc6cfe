"""Time stamps that are off: found in the log alone, and told from samples that are uneven themselves."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.recordings import Recording, estimate_jitter, stamp_errors

PERIOD, SD, NOISE = 0.01, 0.002, 4e-4


def log(stamps: np.ndarray, instants: np.ndarray, noise: float = NOISE, joints: int = 4, seed: int = 0) -> Recording:
    """Sines of up to 2 Hz and about 2 rad/s per joint, seen at instants (T,) and logged under stamps (T,)."""
    rng = np.random.default_rng(seed)
    position = np.zeros((len(instants), joints))
    for j in range(joints):
        for rate in rng.uniform(2.0, 12.0, 3):
            position[:, j] += 1.0 / rate * np.sin(rate * instants + rng.uniform(0, 6))
    position += noise * rng.standard_normal(position.shape)
    names = tuple(f"j{j}" for j in range(joints))
    return Recording(
        "sines-1", names, stamps, position, noise=np.full(joints, max(noise, 1e-6)), quantum=np.zeros(joints)
    )


def clock(seed: int = 0, count: int = 500, sd: float = SD) -> tuple[np.ndarray, np.ndarray]:
    """Even instants (T,) and white errors (T,), s."""
    error = np.clip(sd * np.random.default_rng(seed + 10).standard_normal(count), -0.45 * PERIOD, 0.45 * PERIOD)
    return PERIOD * np.arange(count), error


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_a_late_stamp_is_found_late(noise: float) -> None:
    even, error = clock()
    recording = log(even + error, even, noise)
    sd, (late,) = stamp_errors([recording])
    assert estimate_jitter(recording) == sd == pytest.approx(np.std(error), rel=0.05)
    assert np.std(late - error) < 0.25 * SD


@pytest.mark.parametrize("seed", range(3))
def test_even_stamps_of_uneven_samples_are_found_out(seed: int) -> None:
    """Their own evenness says nothing: the positions alone show it, less what a local cubic swallows."""
    even, error = clock(seed)
    sd, (late,) = stamp_errors([log(even, even - error, seed=seed)])
    assert sd == pytest.approx(np.std(error), rel=0.3)
    assert np.std(late - error) < 0.6 * np.std(error)
    assert np.sum(late * error) / np.sum(late**2) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("seed", range(5))
def test_a_good_clock_is_not_accused(seed: int) -> None:
    """Neither of even samples, nor of uneven ones with their own times, nor with some lost, nor at rest."""
    even, error = clock(seed)
    kept = np.random.default_rng(seed).random(len(even)) > 0.03
    still = log(even + error, np.zeros(len(even)), seed=seed)
    right = (even, even - error, even[kept])
    for recording in (*(log(times, times, seed=seed) for times in right), still):
        sd, (late,) = stamp_errors([recording])
        assert sd == 0.0 and not late.any()


def test_one_joint_alone_shows_only_what_uneven_stamps_show() -> None:
    even, error = clock()
    assert estimate_jitter(log(even, even - error, joints=1)) == 0.0
    assert estimate_jitter(log(even + error, even, joints=1)) == pytest.approx(np.std(error), rel=0.05)


def test_logs_of_one_clock_are_heard_together() -> None:
    """Also where one of them stands still and says nothing; lost samples do not matter."""
    even, error = clock()
    kept = np.random.default_rng(1).random(len(even)) > 0.03
    moving = log((even + error)[kept], even[kept])
    sd, late = stamp_errors([moving, log(even, np.zeros(len(even)))])
    assert sd > 0.5 * SD
    assert np.std(late[0] - error[kept]) < 0.4 * SD and not late[1].any()
