"""Features of short clips for a Frechet distance: from the user's I3D network (FVD), or fixed random filters (rfvd).

rfvd needs no weights and is NOT FVD: its values are comparable only among clips of one size.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_frames

NO_I3D = "FVD needs a network that is not shipped: give the local path of i3d_torchscript.pt (I3d.load)"
FVD_LENGTH = 16  # frames of a clip, as in publications
RFVD_LENGTH = 8
RFVD_SEED = 2004
CHANNELS = 16  # filters of each of the two layers of rfvd
DIMENSIONS = 4 * CHANNELS  # features of rfvd: mean and sd of each filter's response


def clips_of(frames: np.ndarray, length: int) -> Iterator[np.ndarray]:
    """Cut frames (T, H, W, 3) into consecutive clips (length, H, W, 3); leftover frames are dropped."""
    frames = check_frames(frames)
    for start in range(0, len(frames) - length + 1, length):
        yield frames[start : start + length]


@dataclass(frozen=True, eq=False, repr=False)
class I3d:
    """A TorchScript network: (N, 3, T, H, W), 0 .. 255, with rescale, resize, return_features -> features (N, D)."""

    network: Any
    path: str
    device: str = "cpu"

    def __repr__(self) -> str:
        return f"I3d({self.path!r})"

    @staticmethod
    def load(path: str | Path, device: str = "cpu") -> I3d:
        """Read a network such as i3d_torchscript.pt from a local file that you trust: TorchScript is a program.

        Raises: VisionError where the file is missing or not TorchScript.
        """
        if not Path(path).is_file():
            raise VisionError(f"{path}: there is no such file; give a local TorchScript file (i3d_torchscript.pt).")
        try:
            with warnings.catch_warnings():  # the published file is TorchScript, which torch 2.13 calls deprecated
                warnings.simplefilter("ignore", DeprecationWarning)
                return I3d(torch.jit.load(str(path), map_location=device).eval(), str(path), device)
        except (RuntimeError, ValueError) as error:
            raise VisionError(f"{path}: this is not a TorchScript file; i3d_torchscript.pt is expected.") from error

    @torch.inference_mode()
    def features(self, frames: np.ndarray) -> np.ndarray:
        """Features (n, D) of the clips of FVD_LENGTH in frames (T, H, W, 3), uint8; (0, 0) when T is smaller.

        Raises: VisionError when the network's input or output is not that of I3D.
        """
        rows = []
        for clip in clips_of(frames, FVD_LENGTH):
            video = torch.from_numpy(np.ascontiguousarray(clip)).permute(3, 0, 1, 2)[None].float().to(self.device)
            try:
                row = self.network(video, rescale=True, resize=True, return_features=True)
            except RuntimeError as error:
                raise VisionError(f"{self.path}: it does not accept a clip as i3d_torchscript.pt does.") from error
            if row.ndim != 2 or len(row) != 1:
                raise VisionError(f"{self.path}: it returns {tuple(row.shape)} for one clip; (1, D) is expected.")
            rows.append(row.cpu().numpy().astype(np.float64))
        return np.concatenate(rows) if rows else np.zeros((0, 0))


@torch.inference_mode()
def random_features(frames: np.ndarray) -> np.ndarray:
    """Features (n, 64) of the clips of RFVD_LENGTH in frames (T, H, W, 3), uint8, in 1/255: two layers of random filters.

    Each layer is a convolution over time and space and the absolute value, whose mean and standard deviation over the
    clip are the features.
    """
    first, second = _filters()
    rows = []
    for clip in clips_of(frames, RFVD_LENGTH):
        x = torch.from_numpy(np.ascontiguousarray(clip)).permute(3, 0, 1, 2)[None].float()
        x = F.conv3d(x, first, stride=(1, 2, 2)).abs()
        y = F.conv3d(F.avg_pool3d(x, (1, 2, 2)), second, stride=(2, 1, 1)).abs()
        parts = [part for z in (x, y) for part in (z.mean(dim=(2, 3, 4)), z.std(dim=(2, 3, 4)))]
        rows.append(torch.cat(parts, dim=1).numpy().astype(np.float64))
    return np.concatenate(rows) if rows else np.zeros((0, DIMENSIONS))


@functools.cache
def _filters() -> tuple[torch.Tensor, torch.Tensor]:
    """Filters (16, 3, 3, 5, 5) and (16, 16, 3, 3, 3) of length 1.

    Of every four, one sums to 0 over space (no response to uniform colour), one over time (responds only to change),
    and two stay as drawn.
    """
    rng = np.random.default_rng(RFVD_SEED)
    layers = []
    for shape in ((CHANNELS, 3, 3, 5, 5), (CHANNELS, CHANNELS, 3, 3, 3)):
        weights = rng.standard_normal(shape)
        weights[::4] -= weights[::4].mean(axis=(3, 4), keepdims=True)
        weights[2::4] -= weights[2::4].mean(axis=2, keepdims=True)
        weights /= np.sqrt((weights**2).sum(axis=(1, 2, 3, 4), keepdims=True))
        layers.append(torch.from_numpy(weights.astype(np.float32)))
    return layers[0], layers[1]
