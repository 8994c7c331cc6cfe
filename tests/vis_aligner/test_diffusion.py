"""The noise schedule and few-step sampling."""

from __future__ import annotations

import pytest
import torch

from embodiedreamer_gym.vis_aligner.diffusion import add_noise, draw_times, sample, signal_and_noise


def test_signal_and_noise_share_the_power() -> None:
    signal, noise = signal_and_noise(torch.linspace(0, 1, 11))
    assert torch.allclose(signal**2 + noise**2, torch.ones(11))
    assert signal[0] == 1 and abs(signal[-1]) < 1e-6


def test_at_time_one_nothing_of_the_picture_is_left() -> None:
    """Zero terminal signal: one step from pure noise is what was trained."""
    noise = torch.randn(2, 3, 3, 4, 4)
    noisy = add_noise(1e6 * torch.ones_like(noise), torch.tensor([1.0, 0.0]), noise)
    assert torch.equal(noisy[0], noise[0]) and torch.equal(noisy[1], 1e6 * torch.ones_like(noise[1]))


def test_a_share_of_the_times_is_noise_alone() -> None:
    times = draw_times(4000, torch.Generator().manual_seed(0))
    assert float((times == 1).float().mean()) == pytest.approx(0.4, abs=0.03)
    assert times.min() < 0.01 and times.max() == 1


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_sampling_with_a_perfect_denoiser_ends_at_the_picture(steps: int) -> None:
    truth, seen = torch.rand(2, 3, 3, 4, 4), []

    def denoise(x: torch.Tensor, time: torch.Tensor) -> torch.Tensor:
        seen.append(float(time[0]))
        return truth

    assert torch.allclose(sample(denoise, torch.randn_like(truth), steps), truth)
    assert len(seen) == steps and seen[0] == 1 and sorted(seen, reverse=True) == seen


def test_between_two_steps_the_noise_is_that_of_the_first() -> None:
    """DDIM: with a perfect denoiser, the clip of a later step is `add_noise` of the same noise."""
    truth, noise, seen = torch.rand(1, 1, 3, 4, 4), torch.randn(1, 1, 3, 4, 4), []
    sample(lambda x, time: (seen.append((x, time)), truth)[1], noise, 4)
    for x, time in seen:
        assert torch.allclose(x, add_noise(truth, time, noise), atol=1e-4)
