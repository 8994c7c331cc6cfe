"""Diffusion with z0-prediction: noise schedule, training noise, few-step sampling.

Sources: Nichol and Dhariwal, Improved DDPM, 2021, eq. 17 (cosine schedule); Lin et al., Common Diffusion Noise
Schedules Are Flawed, 2024 (zero terminal SNR); Song et al., DDIM, 2021, eq. 12.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import torch
from torch import Tensor

PURE = 0.4  # share of training samples that are pure noise, so that one step is enough

Denoiser = Callable[[Tensor, Tensor], Tensor]


def signal_and_noise(time: Tensor) -> tuple[Tensor, Tensor]:
    """Amplitudes of picture and noise at times (B,) from 0 (picture) to 1 (pure noise); their squares add up to one."""
    angle = 0.5 * math.pi * time
    return torch.cos(angle), torch.sin(angle)


def draw_times(count: int, generator: torch.Generator) -> Tensor:
    """Times (count,) to train on: uniform, but a share PURE of them at 1 (pure noise)."""
    time = torch.rand(count, generator=generator)
    return torch.where(torch.rand(count, generator=generator) < PURE, torch.ones(count), time)


def add_noise(clip: Tensor, time: Tensor, noise: Tensor) -> Tensor:
    """Clips (B, T, C, H, W) with the noise of times (B,)."""
    signal, amount = (a.view(-1, 1, 1, 1, 1) for a in signal_and_noise(time))
    amount, signal = torch.where(amount > 0.9999999, 1.0, amount), torch.where(amount > 0.9999999, 0.0, signal)
    return signal * clip + amount * noise


def sample(denoise: Denoiser, noise: Tensor, steps: int) -> Tensor:
    """Clips (B, T, C, H, W) from noise in a few deterministic steps; denoise: (noisy clip, times (B,)) -> clip."""
    times = torch.linspace(1.0, 0.0, steps + 1)  # on the CPU, to avoid synchronising with a GPU
    x, clip = noise, noise
    for now, after in itertools.pairwise(times):
        clip = denoise(x, now.to(noise.device).expand(len(x)))
        if after > 0:
            signal, amount = signal_and_noise(now)
            noise_left = (x - signal * clip) / amount
            signal, amount = signal_and_noise(after)
            x = signal * clip + amount * noise_left
    return clip
