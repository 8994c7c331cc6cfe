"""Where objects are in a picture, how they lie and how large they look, learnt from masks."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import nn
from torch.nn.functional import cross_entropy

from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.samples import Episodes, Progress

CHANNELS = 16
REACH = (1, 2, 4)  # dilations of the layers: a pixel is judged by 15 x 15 around it
NUMBERS = 6  # that are told of an object
STEPS, STEPS_EACH, MOST = 800, 8, 6400  # at least; for each episode, as more of them show more looks; at most
BATCH, RATE = 8, 5e-3
LIGHT = 0.15  # standard deviation of a picture's brightness and of its colours', drawn anew each time
SURE = 0.3  # share from which a pixel counts
BRIDGE = np.ones((3, 3), np.uint8)  # pixels about each, by which pieces are one: gaps of 2 pixels do not count
LEAST = 1e-3  # pixels
FAST = torch.channels_last  # three times as fast here


class Eyes(nn.Module):
    """Pictures (B, 3, H, W) to NUMBERS of each object (B, objects * NUMBERS), as a mask of it has them.

    Of an object: its place, x and y, -1 .. 1 from edge to edge; cosine and sine of twice the angle at which it lies, times how
    long against how wide it is; the roots of its length and of its area. Masks are told pixel by pixel, which a few
    demonstrations teach: each of them has thousands of pixels.
    """

    seen_mean: torch.Tensor
    seen_scale: torch.Tensor

    def __init__(self, objects: int) -> None:
        super().__init__()
        self.classes = 1 + objects
        layers: list[nn.Module] = []
        for number, reach in enumerate(REACH):
            layers += [nn.Conv2d(CHANNELS if number else 3, CHANNELS, 3, padding=reach, dilation=reach), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Conv2d(CHANNELS, self.classes, 1)).to(memory_format=FAST)  # pyright: ignore[reportCallIssue]
        self.register_buffer("seen_mean", torch.zeros(NUMBERS * objects))
        self.register_buffer("seen_scale", torch.ones(NUMBERS * objects))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Numbers of the objects, normalised; no gradient goes through them."""
        with torch.no_grad():
            return (measured(self.judge(pictures).softmax(1)[:, 1:]) - self.seen_mean) / self.seen_scale

    def judge(self, pictures: torch.Tensor) -> torch.Tensor:
        """Of each pixel how likely each object is, 0 being none: logits (B, 1 + objects, H, W)."""
        return self.layers(pictures.contiguous(memory_format=FAST))

    def learn(self, pictures: np.ndarray, masks: np.ndarray, ready: Callable[[np.ndarray], torch.Tensor], seed: int,
              progress: Progress | None = None, episodes: int = 1) -> None:  # fmt: skip
        """Learn to tell masks (N, H, W), 0 for no object, from pictures (N, H, W, 3) uint8 that `ready` normalises.

        episodes: of how many they are.
        """
        steps = max(STEPS, min(STEPS_EACH * episodes, MOST))
        rng = np.random.default_rng([seed, len(masks)])
        share = np.bincount(masks.ravel(), minlength=self.classes) / masks.size
        weight = (
            torch.from_numpy(np.maximum(share, 1e-5) ** -0.5).float().to(self.seen_mean.device)
        )  # small things count too
        optimiser = torch.optim.AdamW(self.layers.parameters(), RATE)
        for step in range(steps):
            for group in optimiser.param_groups:
                group["lr"] = RATE * 0.5 * (1.0 + np.cos(np.pi * step / steps))
            chosen, turned = rng.integers(len(masks), size=BATCH), rng.random(BATCH) < 0.5
            light = np.exp(
                LIGHT * (rng.standard_normal((BATCH, 1, 1, 1)) + 0.5 * rng.standard_normal((BATCH, 1, 1, 3)))
            )
            seen, there = np.clip(pictures[chosen] * light, 0, 255).astype(np.uint8), masks[chosen]
            seen[turned], there[turned] = seen[turned, :, ::-1], there[turned, :, ::-1]
            loss = cross_entropy(
                self.judge(ready(seen)), torch.from_numpy(there.astype(np.int64)).to(weight.device), weight
            )
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            if progress is not None:
                progress("objects", step + 1, steps, f"loss {float(loss.detach()):.4f}")
        with torch.no_grad():
            told = torch.cat([
                measured(self.judge(ready(pictures[i : i + BATCH])).softmax(1)[:, 1:])
                for i in range(0, len(pictures), BATCH)
            ])  # fmt: skip
        self.seen_mean.copy_(told.mean(0))
        self.seen_scale.copy_(
            told.std(0, correction=min(1, len(told) - 1)).clamp(min=0.05)
        )  # a single picture has none


def measured(shares: torch.Tensor) -> torch.Tensor:
    """Numbers (B, objects * NUMBERS) of masks (B, objects, H, W) with shares 0 .. 1, of the largest piece of each."""
    shares = largest((shares - SURE).clamp(min=0.0))
    height, width = shares.shape[2:]
    x = torch.arange(width, device=shares.device) - 0.5 * (width - 1)  # pixels from the middle
    y = torch.arange(height, device=shares.device) - 0.5 * (height - 1)
    area, mx, my, xx, yy, xy = _moments(shares, x, y)
    spread = (xx + yy).clamp(min=0.0) + 0.1
    told = [
        2.0 * mx / width,
        2.0 * my / height,
        (xx - yy) / spread,
        2.0 * xy / spread,
        spread.sqrt() / 8.0,
        area.sqrt() / 20.0,
    ]
    return torch.stack(told, 2).flatten(1)


def largest(shares: torch.Tensor) -> torch.Tensor:
    """Masks (B, objects, H, W), 0 where there is nothing, with the largest piece of each only; no gradient goes through.

    Specks elsewhere would move and tilt an object. What a narrow thing in front cuts in two, a finger, is one piece.
    """
    found = np.ascontiguousarray(shares.detach().cpu().numpy(), np.float32)
    kept = np.zeros_like(found)
    for mask, to in zip(found.reshape(-1, *found.shape[2:]), kept.reshape(-1, *found.shape[2:]), strict=True):
        there = cv2.dilate((mask > 0).astype(np.uint8), BRIDGE)
        pieces, numbers = cv2.connectedComponents(there)
        if pieces > 1:
            mass = np.bincount(numbers.ravel(), mask.ravel(), pieces)
            np.copyto(to, mask, where=numbers == 1 + int(np.argmax(mass[1:])))
    return torch.from_numpy(kept).to(shares.device)


def _moments(shares: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Area, means, variances and covariance, each (B, objects), of masks over columns x and rows y."""
    columns, rows = shares.sum(2), shares.sum(3)
    area = columns.sum(2) + LEAST
    mx, my = (columns @ x) / area, (rows @ y) / area
    xx, yy = (columns @ x.square()) / area - mx.square(), (rows @ y.square()) / area - my.square()
    return area, mx, my, xx, yy, ((shares @ x) * y).sum(2) / area - mx * my


def with_eyes(config: ActConfig, episodes: Episodes) -> ActConfig:
    """The same with eyes, and layers of their size, for the objects that the masks of a set tell apart; as it is without."""
    names = tuple(getattr(episodes, "objects", {}))
    return config.with_(objects=names, keypoints=0, width=256, feedforward=512, encoders=2) if names else config
