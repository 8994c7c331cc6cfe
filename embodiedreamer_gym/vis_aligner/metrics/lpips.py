"""LPIPS: the distance of two pictures in the features of a network trained on photographs.

The weights are not shipped. You need the trunk (AlexNet or VGG16 trained on ImageNet, a state dict as torchvision
publishes it) and the heads (`alex.pth` or `vgg.pth` of the lpips project, version 0.1) as local files.
Source: Zhang et al. 2018, The Unreasonable Effectiveness of Deep Features as a Perceptual Metric, equation 1.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics.checks import check_pair

NO_WEIGHTS = "LPIPS needs weights that are not shipped: give a trunk and its heads as local files (Lpips.load)"
MEAN = (-0.030, -0.088, -0.188)  # of pictures in -1 .. 1, per channel; lpips project, class ScalingLayer
SD = (0.458, 0.448, 0.450)
BATCH = 8  # frames per forward pass


def _convolutions(*channels: int) -> list[nn.Module]:
    """3 x 3 convolutions from each number of channels to the next, each with a ReLU."""
    pairs = itertools.pairwise(channels)
    return [layer for inside, out in pairs for layer in (nn.Conv2d(inside, out, 3, padding=1), nn.ReLU())]


def _alex() -> nn.Sequential:
    """AlexNet's `features`, numbered as torchvision's."""
    first, second = nn.Conv2d(3, 64, 11, 4, 2), nn.Conv2d(64, 192, 5, padding=2)
    pool = nn.MaxPool2d(3, 2)
    return nn.Sequential(first, nn.ReLU(), pool, second, nn.ReLU(), pool, *_convolutions(192, 384, 256, 256))


def _vgg() -> nn.Sequential:
    """VGG16's `features` without its last pool, numbered as torchvision's."""
    pool = nn.MaxPool2d(2, 2)
    stages = (3, 64, 64), (64, 128, 128), (128, 256, 256, 256), (256, 512, 512, 512), (512, 512, 512, 512)
    return nn.Sequential(*[layer for stage in stages for layer in (*_convolutions(*stage), pool)][:-1])


TRUNKS = {  # network, its tapped layers, smallest side of a picture
    "alex": (_alex, (1, 4, 7, 9, 11), 31),
    "vgg": (_vgg, (3, 8, 15, 22, 29), 16),
}


@dataclass(frozen=True, eq=False, repr=False)
class Lpips:
    """A trunk and its heads.

    net: alex or vgg.
    trunk: the network up to its last tapped layer.
    heads: weights (C,) of the channels of each tapped layer.
    """

    net: str
    trunk: nn.Sequential
    heads: tuple[torch.Tensor, ...]

    def __repr__(self) -> str:
        return f"Lpips({self.net!r})"

    @staticmethod
    def load(trunk: str | Path, heads: str | Path, net: str = "alex", device: str = "cpu") -> Lpips:
        """Read the two files; only `features.*` of the trunk is used.

        Raises: VisionError for a missing file, a file that is not a state dict, other layers, or an unknown net.
        """
        if net not in TRUNKS:
            raise VisionError(f"net {net!r} is not one of {', '.join(TRUNKS)}.")
        make, taps, _ = TRUNKS[net]
        network, weights, linear = make(), _state(trunk), _state(heads)
        own = network.state_dict()
        network.load_state_dict({key: _taken(weights, f"features.{key}", tuple(own[key].shape), trunk) for key in own})
        channels = [len(own[f"{tap - 1}.weight"]) for tap in taps]
        lines = [_taken(linear, f"lin{k}.model.1.weight", (1, n, 1, 1), heads) for k, n in enumerate(channels)]
        return Lpips(net, network.to(device).eval(), tuple(line.flatten().to(device) for line in lines))

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
        device = self.heads[0].device
        x = torch.from_numpy(np.ascontiguousarray(frames)).to(device).permute(0, 3, 1, 2) / 127.5 - 1.0
        x = (x - torch.tensor(MEAN, device=device)[:, None, None]) / torch.tensor(SD, device=device)[:, None, None]
        taps = []
        for number, layer in enumerate(self.trunk):
            x = layer(x)
            if number in TRUNKS[self.net][1]:
                taps.append(x)
        return taps


def _normalised(x: torch.Tensor) -> torch.Tensor:
    """Activations normalised to length 1 over channels; the constant is from the lpips project."""
    return x / (x.square().sum(dim=1, keepdim=True).sqrt() + 1e-10)


def _state(path: str | Path) -> dict[str, Any]:
    """Read a state dict from a file.

    Raises: VisionError where there is none.
    """
    if not Path(path).is_file():
        raise VisionError(f"{path}: there is no such file; give a local state dict (.pth).")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds of errors for other files
        raise VisionError(
            f"{path}: this is not a state dict that contains only tensors ({type(error).__name__})."
        ) from error
    if not isinstance(state, dict):
        raise VisionError(f"{path}: this holds a {type(state).__name__}, but a state dict is expected.")
    return state


def _taken(state: dict[str, Any], key: str, shape: tuple[int, ...], path: str | Path) -> torch.Tensor:
    tensor = state.get(key)
    if not isinstance(tensor, torch.Tensor) or tuple(tensor.shape) != shape:
        given = "nothing" if tensor is None else f"shape {tuple(getattr(tensor, 'shape', ()))}"
        raise VisionError(f"{path}: {given} is under {key!r}, shape {shape} is expected; give the weights of this net.")
    return tensor.float()
