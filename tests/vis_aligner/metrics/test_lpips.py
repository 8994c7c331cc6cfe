"""LPIPS against a second, literal writing of its formula, on made-up weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner.metrics import Lpips

TAPS = {"alex": (1, 4, 7, 9, 11), "vgg": (3, 8, 15, 22, 29)}  # places of the ReLUs in the published networks
PLAN = {
    "alex": ("64/11/4/2", "M3", "192/5/1/2", "M3", "384/3/1/1", "256/3/1/1", "256/3/1/1"),
    "vgg": ("64/3/1/1", "64/3/1/1", "M2", "128/3/1/1", "128/3/1/1", "M2", *["256/3/1/1"] * 3, "M2",
            *["512/3/1/1"] * 3, "M2", *["512/3/1/1"] * 3),
}  # fmt: skip


def published(net: str) -> nn.Sequential:
    """`features` of AlexNet or VGG16, layer for layer as torchvision numbers them, with random weights."""
    torch.manual_seed(0)
    layers: list[nn.Module] = []
    channels = 3
    for step in PLAN[net]:
        if step[0] == "M":
            layers.append(nn.MaxPool2d(int(step[1]), 2))
        else:
            out, kernel, stride, padding = map(int, step.split("/"))
            convolution = nn.Conv2d(channels, out, kernel, stride, padding)
            nn.init.kaiming_normal_(convolution.weight)
            layers += [convolution, nn.ReLU()]
            channels = out
    return nn.Sequential(*layers).eval()


def saved(net: str, folder: Path) -> tuple[nn.Sequential, list[torch.Tensor], Path, Path]:
    trunk, rng = published(net), torch.Generator().manual_seed(1)
    state = {f"features.{k}": v for k, v in trunk.state_dict().items()}
    state["classifier.1.weight"] = torch.zeros(2, 2)  # is there in the published file and not looked at
    widths = [trunk[place - 1].out_channels for place in TAPS[net]]
    heads = [torch.rand(1, n, 1, 1, generator=rng) for n in widths]
    torch.save(state, folder / "trunk.pth")
    torch.save({f"lin{k}.model.1.weight": head for k, head in enumerate(heads)}, folder / "heads.pth")
    return trunk, heads, folder / "trunk.pth", folder / "heads.pth"


def literal(
    trunk: nn.Sequential, taps: tuple[int, ...], heads: list[torch.Tensor], a: np.ndarray, b: np.ndarray
) -> float:
    """d = sum over layers of the mean over places of || w * (y - y0) ||^2, y of unit length over channels."""
    outputs = []
    for picture in (a, b):
        x = torch.from_numpy(picture).permute(2, 0, 1)[None].float() / 255 * 2 - 1
        x = (x - torch.tensor([-0.030, -0.088, -0.188]).view(1, 3, 1, 1)) / torch.tensor([0.458, 0.448, 0.450]).view(
            1, 3, 1, 1
        )
        kept = []
        for place, layer in enumerate(trunk):
            x = layer(x)
            if place in taps:
                kept.append(x[0].detach().numpy().astype(np.float64))
        outputs.append(kept)
    total = 0.0
    for f, g, head in zip(*outputs, heads, strict=True):
        f, g = (y / (np.sqrt((y**2).sum(axis=0)) + 1e-10) for y in (f, g))
        total += (head[0, :, 0, 0].numpy()[:, None, None] * (f - g) ** 2).sum(axis=0).mean()
    return total


@pytest.mark.parametrize(("net", "count"), [("alex", 9), ("vgg", 2)])  # 9: more than go through at once
def test_it_is_its_formula(net: str, count: int, tmp_path: Path, bench) -> None:
    trunk, heads, *paths = saved(net, tmp_path)
    truth = bench.frames[:count, :48, :64]
    generated = bench.simulated[:count, :48, :64]
    found = Lpips.load(*paths, net).distances(generated, truth)
    expected = [literal(trunk, TAPS[net], heads, a, b) for a, b in zip(generated, truth, strict=True)]
    assert found == pytest.approx(expected, rel=1e-4) and min(expected) > 1e-3
    assert Lpips.load(*paths, net).distances(truth[:1], truth[:1]) == 0.0


def test_other_files_are_refused(tmp_path: Path) -> None:
    *_, trunk, heads = saved("alex", tmp_path)
    with pytest.raises(VisionError, match="not one of alex, vgg"):
        Lpips.load(trunk, heads, "squeeze")
    with pytest.raises(VisionError, match=r"absent\.pth: there is no such file"):
        Lpips.load(tmp_path / "absent.pth", heads)
    with pytest.raises(VisionError, match=r"nothing is under 'features\.0\.weight'"):
        Lpips.load(heads, trunk)
    with pytest.raises(
        VisionError, match=r"shape \(64, 3, 11, 11\) is under 'features\.0\.weight', shape \(64, 3, 3, 3\)"
    ):
        Lpips.load(trunk, heads, "vgg")
    (tmp_path / "text.pth").write_text("weights")
    with pytest.raises(VisionError, match="not a state dict that contains only tensors"):
        Lpips.load(tmp_path / "text.pth", heads)
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(VisionError, match="holds a list"):
        Lpips.load(tmp_path / "list.pth", heads)


def test_a_file_that_runs_code_is_refused(tmp_path: Path) -> None:
    *_, heads = saved("alex", tmp_path)
    torch.save(nn.Linear(2, 2), tmp_path / "module.pth")  # a whole module: needs its class to be called
    with pytest.raises(VisionError, match="not a state dict that contains only tensors"):
        Lpips.load(tmp_path / "module.pth", heads)


def test_pictures_smaller_than_the_trunk_are_refused(tmp_path: Path) -> None:
    *_, trunk, heads = saved("alex", tmp_path)
    network = Lpips.load(trunk, heads)
    assert network.distances(*np.zeros((2, 1, 31, 31, 3), np.uint8)).tolist() == [0.0]
    with pytest.raises(VisionError, match="at least 31x31, not 40x30"):
        network.distances(*np.zeros((2, 1, 30, 40, 3), np.uint8))
