"""Position, orientation and size of objects in a picture, learnt from masks."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import nn
from torch.nn.functional import cross_entropy

from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.learning.optimisation import Optimisation
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.recordings.episodes import EpisodeSet

CHANNELS = 16
DILATIONS = (1, 2, 4)  # of the layers: a pixel is classified from the 15 x 15 pixels around it
POSE_SIZE = 6  # numbers for an object
LEAST_STEPS, STEPS_PER_EPISODE, MOST_STEPS = 800, 8, 6400  # more episodes have more varied pictures
BATCH, LEARNING_RATE = 8, 5e-3
BRIGHTNESS = 0.15  # standard deviation of a picture's log brightness, drawn in training; half of it for each colour
PROBABLE = 0.3  # probability above which a pixel counts
BRIDGE = np.ones((3, 3), np.uint8)  # dilation of a mask before its components are found: bridges gaps of 2 pixels
LEAST = 1e-3  # pixels, added to an area
FAST = torch.channels_last  # memory layout that is three times as fast here


class ObjectPoseHead(nn.Module):
    """Maps pictures (B, 3, H, W) to POSE_SIZE numbers for each object (B, objects * POSE_SIZE).

    Numbers of an object: position x and y, -1 .. 1 from edge to edge; cosine and sine of twice its angle, multiplied by
    its elongation; square roots of its spread (a variance) and of its area. They are computed from masks that are
    predicted pixel by pixel. A few demonstrations are enough to train this, because each has thousands of pixels.
    """

    pose_mean: torch.Tensor
    pose_scale: torch.Tensor

    def __init__(self, objects: int) -> None:
        super().__init__()
        self.classes = 1 + objects
        layers: list[nn.Module] = []
        for number, dilation in enumerate(DILATIONS):
            convolution = nn.Conv2d(CHANNELS if number else 3, CHANNELS, 3, padding=dilation, dilation=dilation)
            layers += [convolution, nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Conv2d(CHANNELS, self.classes, 1)).to(memory_format=FAST)  # pyright: ignore[reportCallIssue]
        self.register_buffer("pose_mean", torch.zeros(POSE_SIZE * objects))
        self.register_buffer("pose_scale", torch.ones(POSE_SIZE * objects))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Normalised numbers of the objects; no gradient flows through them."""
        with torch.no_grad():
            return (self._poses(pictures) - self.pose_mean) / self.pose_scale

    def logits(self, pictures: torch.Tensor) -> torch.Tensor:
        """Logits (B, 1 + objects, H, W) of each pixel's class, 0 being no object."""
        return self.layers(pictures.contiguous(memory_format=FAST))

    def fit(self, pictures: np.ndarray, masks: np.ndarray, normalise: Callable[[np.ndarray], torch.Tensor], seed: int,
            progress: ProgressCallback | None = None, episodes: int = 1) -> None:  # fmt: skip
        """Train on masks (N, H, W), 0 for no object, of pictures (N, H, W, 3) uint8.

        normalise: converts pictures to the layers' input.
        seed: of the order of the pictures, and of the brightness and mirroring that each step draws.
        episodes: number of episodes that the pictures come from.
        """
        steps = max(LEAST_STEPS, min(STEPS_PER_EPISODE * episodes, MOST_STEPS))
        rng, shown = np.random.default_rng([seed, len(masks)]), progress_or_silence(progress)
        share = np.bincount(masks.ravel(), minlength=self.classes) / masks.size
        weight = torch.from_numpy(np.maximum(share, 1e-5) ** -0.5).float()  # so that small objects count too
        weight = weight.to(self.pose_mean.device)
        optimisation = Optimisation(self.layers.parameters(), steps, LEARNING_RATE, warm_up=1)
        for step in range(steps):
            chosen, mirrored = rng.integers(len(masks), size=BATCH), rng.random(BATCH) < 0.5
            noise = rng.standard_normal((BATCH, 1, 1, 1)) + 0.5 * rng.standard_normal((BATCH, 1, 1, 3))
            seen = np.clip(pictures[chosen] * np.exp(BRIGHTNESS * noise), 0, 255).astype(np.uint8)
            true = masks[chosen]
            seen[mirrored], true[mirrored] = seen[mirrored, :, ::-1], true[mirrored, :, ::-1]
            target = torch.from_numpy(true.astype(np.int64)).to(weight.device)
            loss = cross_entropy(self.logits(normalise(seen)), target, weight)
            optimisation.minimise(loss, step)
            shown("object pose head", step + 1, steps, loss=f"{float(loss.detach()):.4f}")
        with torch.no_grad():
            batches = [pictures[i : i + BATCH] for i in range(0, len(pictures), BATCH)]
            poses = torch.cat([self._poses(normalise(batch)) for batch in batches])
        self.pose_mean.copy_(poses.mean(0))
        scale = poses.std(0, correction=min(1, len(poses) - 1))  # a single picture has no deviation
        self.pose_scale.copy_(scale.clamp(min=0.05))

    def _poses(self, pictures: torch.Tensor) -> torch.Tensor:
        return mask_poses(self.logits(pictures).softmax(1)[:, 1:])


def mask_poses(shares: torch.Tensor) -> torch.Tensor:
    """Numbers (B, objects * POSE_SIZE) of the largest component of each mask of probabilities (B, objects, H, W)."""
    shares = largest_component((shares - PROBABLE).clamp(min=0.0))
    height, width = shares.shape[2:]
    x = torch.arange(width, device=shares.device) - 0.5 * (width - 1)  # pixels from the middle
    y = torch.arange(height, device=shares.device) - 0.5 * (height - 1)
    area, mx, my, xx, yy, xy = _moments(shares, x, y)
    spread = (xx + yy).clamp(min=0.0) + 0.1
    numbers = [2.0 * mx / width, 2.0 * my / height, (xx - yy) / spread, 2.0 * xy / spread, spread.sqrt() / 8.0,
               area.sqrt() / 20.0]  # fmt: skip
    return torch.stack(numbers, 2).flatten(1)


def largest_component(shares: torch.Tensor) -> torch.Tensor:
    """Masks (B, objects, H, W) that keep the largest component of each mask and are 0 elsewhere; without gradient.

    Specks elsewhere would shift and tilt an object's pose. An object that a finger in front of it cuts in two is still
    one component.
    """
    given = np.ascontiguousarray(shares.detach().cpu().numpy(), np.float32)
    kept = np.zeros_like(given)
    for mask, to in zip(given.reshape(-1, *given.shape[2:]), kept.reshape(-1, *given.shape[2:]), strict=True):
        count, numbers = cv2.connectedComponents(cv2.dilate((mask > 0).astype(np.uint8), BRIDGE))
        if count > 1:
            mass = np.bincount(numbers.ravel(), mask.ravel(), count)
            np.copyto(to, mask, where=numbers == 1 + int(np.argmax(mass[1:])))
    return torch.from_numpy(kept).to(shares.device)


def _moments(shares: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Area, means, variances and covariance, each (B, objects), of masks over columns x and rows y."""
    columns, rows = shares.sum(2), shares.sum(3)
    area = columns.sum(2) + LEAST
    mx, my = (columns @ x) / area, (rows @ y) / area
    xx, yy = (columns @ x.square()) / area - mx.square(), (rows @ y.square()) / area - my.square()
    return area, mx, my, xx, yy, ((shares @ x) * y).sum(2) / area - mx * my


def with_object_poses(config: ActConfig, episodes: EpisodeSet) -> ActConfig:
    """A configuration of kind `object_pose`, for the objects in a set's masks, if it has any."""
    names = tuple(getattr(episodes, "objects", {}))
    return config.with_(objects=names, keypoints=0, width=256, feedforward=512, encoders=2) if names else config
