import numpy as np
import pytest

from embodiedreamer_gym.recordings import estimate_noise, estimate_quantum

STEP = 2 * np.pi / 4096


def motion(rate, seconds=20.0):
    time = np.arange(0, seconds, 1 / rate)
    return time, 0.5 * np.sin(2 * np.pi * 0.7 * time) + 0.2 * np.sin(2 * np.pi * 1.9 * time + 1)


def rounded(x, step):
    return np.round(x / step) * step


@pytest.mark.parametrize("rate", [30, 50, 200, 500])
@pytest.mark.parametrize("step", [0.0, STEP])
def test_noise_is_found_under_motion_and_rounding(rate, step):
    time, clean = motion(rate)
    found = []
    for seed in range(9):
        x = clean + 5e-4 * np.random.default_rng(seed).standard_normal(clean.size)
        found.append(estimate_noise(time, rounded(x, step) if step else x, step))
    assert np.median(found) == pytest.approx(5e-4, rel=0.1)
    assert found == pytest.approx([5e-4] * 9, rel=0.4 if step else 0.25)


@pytest.mark.parametrize("rate", [30, 50, 200])
def test_motion_alone_is_hardly_noise(rate):
    time, x = motion(rate)
    assert estimate_noise(time, x) < 1.5e-4
    assert estimate_noise(time, rounded(x, STEP), STEP) == 0


def test_measured_times_that_vary_are_not_noise():
    """Each sample is taken up to 2 ms late, and its time is right."""
    rng, found = np.random.default_rng(4), []
    for _ in range(9):
        time = np.arange(0, 20.0, 0.02) + rng.uniform(0.0, 2e-3, 1000)
        clean = 0.5 * np.sin(2 * np.pi * 0.7 * time) + 0.2 * np.sin(2 * np.pi * 1.9 * time + 1)
        found.append(estimate_noise(time, clean + 3e-4 * rng.standard_normal(1000)))
    assert np.median(found) == pytest.approx(3e-4, rel=0.1) and max(found) < 4e-4


def test_time_stamps_that_vary_of_regular_samples_are_not_noise():
    """Time stamps of 30 Hz in whole milliseconds are 33 or 34 ms apart."""
    time, clean = motion(30)
    x = clean + 5e-4 * np.random.default_rng(0).standard_normal(clean.size)
    assert estimate_noise(np.round(time, 3), x) == pytest.approx(estimate_noise(time, x), rel=0.05)


def test_steps_and_friction_are_not_noise():
    rng = np.random.default_rng(1)
    time = np.arange(1000) / 50
    stairs = np.repeat(rng.uniform(-1, 1, 20), 50)
    assert estimate_noise(time, stairs + 5e-4 * rng.standard_normal(1000)) == pytest.approx(5e-4, rel=0.25)


def test_gaps_in_time_are_not_noise():
    time, x = motion(50)
    keep = np.random.default_rng(2).random(time.size) > 0.05
    assert estimate_noise(time[keep], x[keep]) < 1.5e-4


def test_a_static_rounded_signal_has_no_noise():
    rng = np.random.default_rng(3)
    time = np.arange(500) / 50
    assert estimate_noise(time, np.full(500, 3 * STEP), STEP) == 0
    dithering = rounded(3.45 * STEP + 0.02 * STEP * rng.standard_normal(500), STEP)
    assert estimate_noise(time, dithering, STEP) == 0


def rests(rng, rate, seconds=20.0):
    """Moves of one second between rests of two, at random positions."""
    time = np.arange(0, seconds, 1 / rate)
    at = np.cumsum(rng.uniform(-0.5, 0.5, 20))
    number, share = np.divmod(time / 3, 1)
    return time, at[number.astype(int)] + np.interp(share, [2 / 3, 1], [0, 1]) * np.diff(at)[number.astype(int)]


@pytest.mark.parametrize("rate", [30, 100, 500])
@pytest.mark.parametrize("share", [0.0, 0.15, 0.25, 0.35])
def test_the_noise_of_a_coarse_encoder_is_found_at_its_rests(rate, share):
    ratio = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        time, x = rests(rng, rate)
        x = rounded(x + share * STEP * rng.standard_normal(x.size), STEP)
        x[rng.integers(x.size, size=3)] += 20 * STEP  # outliers
        ratio.append(np.sqrt((estimate_noise(time, x, STEP) / STEP) ** 2 + 1 / 12) / np.sqrt(share**2 + 1 / 12))
    assert np.median(ratio) == pytest.approx(1, abs=0.06)
    assert ratio == pytest.approx([1] * 8, abs=0.25)


def test_one_rest_within_a_code_shows_no_noise_and_one_between_two_codes_no_more_than_their_flips():
    rng = np.random.default_rng(5)
    time, noise = np.arange(600) / 100, 0.1 * STEP * rng.standard_normal(600)
    assert estimate_noise(time, rounded(noise, STEP), STEP) == 0
    assert 0 < estimate_noise(time, rounded(noise + 0.5 * STEP, STEP), STEP) < 0.4 * STEP


@pytest.mark.parametrize("rate", [50, 200])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("noise", [0.0, 5e-4])
@pytest.mark.parametrize("offset", [0.0, 1.234, -3.0])
def test_a_12_bit_encoder_is_recognised(rate, kind, noise, offset):
    _, x = motion(rate)
    x = x + noise * np.random.default_rng(4).standard_normal(x.size)
    assert estimate_quantum((rounded(x, STEP) + offset).astype(kind)) == pytest.approx(STEP, rel=1e-3)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_a_continuous_signal_has_no_quantum(kind, noise):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        _, x = motion(50, seconds=rng.uniform(1, 60))
        assert estimate_quantum((x * rng.uniform(0.1, 3) + noise * rng.standard_normal(x.size)).astype(kind)) == 0


def test_few_values_say_little():
    assert estimate_quantum(np.full(100, 0.3)) == 0
    assert estimate_quantum(np.repeat([0.0, 1.0], 50)) == 0  # one step is a motion, not an encoder
    assert estimate_quantum(np.tile([0.3, 0.3 + STEP], 50)) == pytest.approx(STEP)


def test_a_few_odd_samples_do_not_hide_the_encoder():
    _, x = motion(50)
    x = rounded(x, STEP)
    x[100] += 0.37 * STEP
    x[500] += 0.61 * STEP
    assert estimate_quantum(x) == pytest.approx(STEP, rel=1e-3)
