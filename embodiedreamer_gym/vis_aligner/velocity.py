"""Diffusion with v-prediction, as Stable Video Diffusion was trained: noise levels, training pairs, few-step sampling.

The noise level is sigma, the standard deviation of the noise on a clean clip z of unit variance. The network takes
y = cos(x) z + sin(x) n with tan(x) = sigma, and the level 1/4 ln(sigma); it predicts v = cos(x) n - sin(x) z.

Sources: Salimans and Ho, Progressive Distillation, 2022, appendix D (v); Karras et al., Elucidating the Design Space of
Diffusion-Based Generative Models, 2022, table 1 and eq. 5 (preconditioning, steps); Blattmann et al., Stable Video
Diffusion, 2023, appendix D (levels, log-normal draws).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import torch
from torch import Tensor

LARGEST, SMALLEST, BEND = 700.0, 0.002, 7.0  # largest and smallest level of sampling, and rho of their spacing
MEAN, SPREAD = 0.7, 1.6  # mean and standard deviation of ln(sigma) in training
PURE = 0.4  # share of training samples at the largest level, so that few steps are enough

Predictor = Callable[[Tensor, Tensor], Tensor]


def draw_sigmas(count: int, generator: torch.Generator) -> Tensor:
    """Noise levels (count,) to train on: log-normal, but a share PURE of them at the largest level."""
    sigma = torch.exp(MEAN + SPREAD * torch.randn(count, generator=generator)).clamp(SMALLEST, LARGEST)
    return torch.where(torch.rand(count, generator=generator) < PURE, LARGEST, sigma)


def noise_condition(sigma: Tensor) -> Tensor:
    """The network's input for a noise level."""
    return 0.25 * torch.log(sigma)


def noisy_and_velocity(clip: Tensor, sigma: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """The network's input y and its target v, for clips (B, ...) at levels (B,)."""
    signal, amount = _amplitudes(sigma, clip)
    return signal * clip + amount * noise, signal * noise - amount * clip


def clean_clip(noisy: Tensor, velocity: Tensor, sigma: Tensor) -> Tensor:
    """The clean clip from a prediction of v; noisy, velocity (B, ...), sigma (B,)."""
    signal, amount = _amplitudes(sigma, noisy)
    return signal * noisy - amount * velocity


def sigmas(steps: int) -> Tensor:
    """Levels (steps + 1,) of sampling, from the largest to 0.

    Spaced as by Karras et al.; the smallest level is replaced by 0, as a step between them would change nothing.
    """
    ends = torch.tensor([LARGEST, SMALLEST], dtype=torch.float64) ** (1 / BEND)
    level = torch.lerp(ends[0], ends[1], torch.linspace(0.0, 1.0, steps + 1, dtype=torch.float64)) ** BEND
    level[-1] = 0.0
    return level.float()


def sample_velocity(predict: Predictor, noise: Tensor, levels: Tensor) -> Tensor:
    """Clips (B, ...) from noise in deterministic Euler steps; predict: noisy clip, levels (B,) -> v; see `sigmas`."""
    y, clip = noise, noise
    for now, after in itertools.pairwise(levels.to(noise.device)):
        level = now.expand(len(y))
        velocity = predict(y, level)
        clip = clean_clip(y, velocity, level)
        signal, amount = _amplitudes(level, y)
        y, _ = noisy_and_velocity(clip, after.expand(len(y)), amount * y + signal * velocity)
    return clip


def _amplitudes(sigma: Tensor, like: Tensor) -> tuple[Tensor, Tensor]:
    """cos(x) and sin(x) of levels (B,), shaped to multiply clips (B, ...)."""
    sigma = sigma.view(-1, *[1] * (like.ndim - 1))
    signal = torch.rsqrt(1.0 + sigma**2)
    return signal, sigma * signal
