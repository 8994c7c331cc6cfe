"""The noise levels, the prediction and the sampler of Stable Video Diffusion."""

from __future__ import annotations

import pytest
import torch

from embodiedreamer_gym.vis_aligner.velocity import (
    LARGEST,
    SMALLEST,
    clean_clip,
    draw_sigmas,
    noise_condition,
    noisy_and_velocity,
    sample_velocity,
    sigmas,
)


def scheduler(steps: int):
    """diffusers' sampler with the settings of Stable Video Diffusion (scheduler_config.json of stable-video-diffusion-img2vid-xt)."""
    diffusers = pytest.importorskip("diffusers", reason="the extra [svd] is not installed")
    made = diffusers.EulerDiscreteScheduler(
        beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", interpolation_type="linear", num_train_timesteps=1000,
        prediction_type="v_prediction", sigma_max=700.0, sigma_min=0.002,
        steps_offset=1, timestep_spacing="leading", timestep_type="continuous", trained_betas=None, use_karras_sigmas=True,
    )  # fmt: skip
    made.set_timesteps(steps)
    return made


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_the_preconditioning_is_that_of_diffusers() -> None:
    """EDM's c_in, c_noise, c_skip and c_out, one step at each of 25 noise levels."""
    theirs, one, none = scheduler(25), torch.ones(1, 1), torch.zeros(1, 1)
    levels = theirs.sigmas[:-1].clone()
    assert levels[0] == pytest.approx(LARGEST) and levels[-1] == pytest.approx(SMALLEST)
    assert torch.allclose(noise_condition(levels), theirs.timesteps, rtol=1e-6, atol=1e-6)
    for level, time in zip(levels, theirs.timesteps, strict=True):
        scaled = theirs.scale_model_input(one, time)
        ours = noisy_and_velocity(none, level[None], one / level)[
            0
        ]  # noise alone, of standard deviation sigma, is 1 here
        assert torch.allclose(ours, scaled, rtol=1e-6, atol=1e-6)
        c_skip = clean_clip(scaled, none, level[None])
        c_out = clean_clip(none, one, level[None])
        x, prediction = torch.tensor([[0.7]]), torch.tensor([[-0.4]])
        clean = theirs.step(prediction, time, x).pred_original_sample
        assert torch.allclose(c_skip * x + c_out * prediction, clean, rtol=1e-6, atol=1e-6)


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_the_sampler_is_eulers() -> None:
    """The same levels and the same network give what diffusers' sampler gives."""
    theirs, noise = scheduler(6), torch.randn(2, 3, 4, 5, generator=torch.Generator().manual_seed(0))
    network = lambda y, level: torch.tanh(1.3 * y + level.view(-1, 1, 1, 1))  # noqa: E731
    ours = sample_velocity(lambda y, sigma: network(y, noise_condition(sigma)), noise, theirs.sigmas.clone())
    x = noise * theirs.init_noise_sigma
    for time in theirs.timesteps:
        x = theirs.step(network(theirs.scale_model_input(x, time), time.expand(2)), time, x).prev_sample
    assert torch.allclose(ours, x, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("sigma", [0.01, 1.0, 50.0, LARGEST])
def test_the_true_velocity_gives_the_clip(sigma: float) -> None:
    clip, noise = torch.randn(2, 3, 4, generator=torch.Generator().manual_seed(1)), torch.ones(2, 3, 4)
    level = torch.full((2,), sigma)
    noisy, velocity = noisy_and_velocity(clip, level, noise)
    assert torch.allclose(clean_clip(noisy, velocity, level), clip, atol=1e-5)


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_a_perfect_network_ends_at_the_clip(steps: int) -> None:
    """Each step's input is the clip with what is left of the first noise."""
    generator, seen = torch.Generator().manual_seed(2), []
    truth, noise = (torch.randn(2, 3, 4, 4, generator=generator) for _ in range(2))

    def perfect(y: torch.Tensor, sigma: torch.Tensor) -> torch.Tensor:
        signal = (1 + sigma**2).rsqrt().view(-1, 1, 1, 1)
        left = (y - signal * truth) / (1 - signal**2).sqrt()
        seen.append((float(sigma[0]), left))
        return noisy_and_velocity(truth, sigma, left)[1]

    assert torch.allclose(sample_velocity(perfect, noise, sigmas(steps)), truth, atol=1e-4)
    levels = [level for level, _ in seen]
    assert levels[0] == LARGEST and levels == sorted(levels, reverse=True) and len(levels) == steps
    assert all(torch.allclose(left, seen[0][1], atol=1e-3) for _, left in seen)


def test_training_sees_the_level_at_which_sampling_begins() -> None:
    drawn = draw_sigmas(4000, torch.Generator().manual_seed(0))
    assert float((drawn == LARGEST).float().mean()) == pytest.approx(0.4, abs=0.03)
    rest = torch.log(drawn[drawn < LARGEST])
    assert float(rest.mean()) == pytest.approx(0.7, abs=0.1) and float(rest.std()) == pytest.approx(1.6, abs=0.1)
