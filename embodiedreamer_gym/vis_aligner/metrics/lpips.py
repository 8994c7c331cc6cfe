"""LPIPS: how far two pictures lie apart in the eyes of a network trained on photographs.

The weights are not shipped. Bring the trunk (AlexNet or VGG16 of ImageNet, a state dict as torchvision publishes it)
and the heads (`alex.pth` or `vgg.pth` of the lpips project, version 0.1) as local files.
Source: Zhang et al. 2018, The Unreasonable Effectiveness of Deep Features as a Perceptual Metric, equation 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_pair

NO_WEIGHTS = "LPIPS needs weights that are not shipped: give a trunk and its heads as local files (Lpips.load)"
MEAN = (-0.030, -0.088, -0.188)  # of pictures in -1 .. 1, per channel; lpips project, class ScalingLayer
SD = (0.458, 0.448, 0.450)
BATCH = 8  # frames that go through the network at once


@dataclass(frozen=True)
class Convolution:
    """One convolution of a trunk, with a ReLU: its key, output channels, kernel, stride; pool before, tap after it."""

    key: int
    channels: int
    kernel: int = 3
    stride: int = 1
    pool: bool = False
    tap: bool = True


ALEX = (
    Convolution(0, 64, 11, 4),
    Convolution(3, 192, 5, pool=True),
    Convolution(6, 384, pool=True),
    Convolution(8, 256),
    Convolution(10, 256),
)
VGG = (
    Convolution(0, 64, tap=False), Convolution(2, 64),
    Convolution(5, 128, pool=True, tap=False), Convolution(7, 128),
    Convolution(10, 256, pool=True, tap=False), Convolution(12, 256, tap=False), Convolution(14, 256),
    Convolution(17, 512, pool=True, tap=False), Convolution(19, 512, tap=False), Convolution(21, 512),
    Convolution(24, 512, pool=True, tap=False), Convolution(26, 512, tap=False), Convolution(28, 512),
)  # fmt: skip
TRUNKS = {"alex": (ALEX, 3, 31), "vgg": (VGG, 2, 16)}  # convolutions, side of a pool, least side of a picture


@dataclass(frozen=True, eq=False, repr=False)
class Lpips:
    """A trunk and its heads. net: alex or vgg; trunk: (weight, bias) by layer; heads: (C,) by tap."""

    net: str
    trunk: tuple[tuple[torch.Tensor, torch.Tensor], ...]
    heads: tuple[torch.Tensor, ...]

    def __repr__(self) -> str:
        return f"Lpips({self.net!r})"

    @staticmethod
    def load(trunk: str | Path, heads: str | Path, net: str = "alex", device: str = "cpu") -> Lpips:
        """Read the two files; of the trunk only `features.*` is used.

        Raises: VisionError for a missing file, one that is no state dict, other layers, or another net.
        """
        if net not in TRUNKS:
            raise VisionError(f"net {net!r} is none of {', '.join(TRUNKS)}.")
        layers, inputs, found = TRUNKS[net][0], 3, []
        weights, linear = _state(trunk), _state(heads)
        for layer in layers:
            shape = (layer.channels, inputs, layer.kernel, layer.kernel)
            weight = _taken(weights, f"features.{layer.key}.weight", shape, trunk, device)
            found.append((weight, _taken(weights, f"features.{layer.key}.bias", shape[:1], trunk, device)))
            inputs = layer.channels
        taps = [layer.channels for layer in layers if layer.tap]
        lines = [_taken(linear, f"lin{k}.model.1.weight", (1, n, 1, 1), heads, device) for k, n in enumerate(taps)]
        return Lpips(net, tuple(found), tuple(line.flatten() for line in lines))

    @torch.inference_mode()
    def distances(self, generated: np.ndarray, truth: np.ndarray) -> np.ndarray:
        """Distance (T,) of each frame (T, H, W, 3), uint8, from the true one; 0 where they are equal.

        Raises: VisionError when the clips differ in size or are too small for the trunk.
        """
        generated, truth = check_pair(generated, truth)
        least = TRUNKS[self.net][2]
        if min(truth.shape[1:3]) < least:
            raise VisionError(f"LPIPS needs frames of at least {least}x{least}, not {truth.shape[2]}x{truth.shape[1]}.")
        values = []
        for start in range(0, len(truth), BATCH):
            taps = [self._taps(clip[start : start + BATCH]) for clip in (generated, truth)]
            value = torch.zeros(len(taps[0][0]), device=self.heads[0].device)
            for head, f, g in zip(self.heads, *taps, strict=True):
                square = (_normalised(f) - _normalised(g)) ** 2
                value += torch.einsum("c,nchw->nhw", head, square).mean(dim=(1, 2))
            values.append(value.cpu().numpy())
        return np.concatenate(values).astype(np.float64)

    def _taps(self, frames: np.ndarray) -> list[torch.Tensor]:
        """Activations (N, C, h, w) of the tapped layers."""
        layers, side, _ = TRUNKS[self.net]
        device = self.heads[0].device
        x = torch.from_numpy(np.ascontiguousarray(frames)).to(device).permute(0, 3, 1, 2) / 127.5 - 1.0
        x = (x - torch.tensor(MEAN, device=device)[:, None, None]) / torch.tensor(SD, device=device)[:, None, None]
        taps = []
        for layer, (weight, bias) in zip(layers, self.trunk, strict=True):
            x = F.max_pool2d(x, side, 2) if layer.pool else x
            padding = 2 if layer.kernel == 11 else layer.kernel // 2  # of AlexNet's first: 2, not half its kernel
            x = F.relu(F.conv2d(x, weight, bias, layer.stride, padding))
            if layer.tap:
                taps.append(x)
        return taps


def _normalised(x: torch.Tensor) -> torch.Tensor:
    """Activations with length 1 over channels; the constant is the lpips project's."""
    return x / (x.square().sum(dim=1, keepdim=True).sqrt() + 1e-10)


def _state(path: str | Path) -> dict[str, Any]:
    """Read a state dict from a file.

    Raises: VisionError where there is none.
    """
    if not Path(path).is_file():
        raise VisionError(f"{path}: there is no such file; give a local state dict (.pth).")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds for a file that is not its own
        raise VisionError(f"{path}: this is no state dict of tensors alone ({type(error).__name__}).") from error
    if not isinstance(state, dict):
        raise VisionError(f"{path}: this holds a {type(state).__name__}, a state dict is expected.")
    return state


def _taken(state: dict[str, Any], key: str, shape: tuple[int, ...], path: str | Path, device: str) -> torch.Tensor:
    tensor = state.get(key)
    if not isinstance(tensor, torch.Tensor) or tuple(tensor.shape) != shape:
        given = "nothing" if tensor is None else f"shape {tuple(getattr(tensor, 'shape', ()))}"
        raise VisionError(f"{path}: {given} is under {key!r}, shape {shape} is expected; give the weights of this net.")
    return tensor.to(device, torch.float32)
