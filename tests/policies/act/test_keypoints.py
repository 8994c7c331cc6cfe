"""Places in pictures, to fractions of a pixel."""

from __future__ import annotations

import torch

from embodiedreamer_gym.policies.act.keypoints import Keypoints


def spot(x: float, y: float) -> torch.Tensor:
    """A bright disc (1, 3, 48, 64) around a place in pixels."""
    rows, columns = torch.meshgrid(torch.arange(48.0), torch.arange(64.0), indexing="ij")
    return torch.exp(-((rows - y) ** 2 + (columns - x) ** 2) / 8.0).expand(1, 3, -1, -1)


def test_a_point_moves_with_what_it_finds() -> None:
    """By about a third of a pixel where the spot moves by that, across and down; nothing else moves it."""
    torch.manual_seed(0)
    points = Keypoints(4)
    with torch.no_grad():
        for layer in points.filters:
            if isinstance(layer, torch.nn.Conv2d):
                layer.weight.fill_(0.02)
                layer.bias.zero_()
        points.sharpness.zero_()
        places = [
            points(spot(30.0 + dx, 20.0 + dy))[0] for dx, dy in ((0.0, 0.0), (1 / 3, 0.0), (0.0, 1 / 3), (9.0, 0.0))
        ]
    pixel = 2.0 / 63
    across = [float(place[0] - places[0][0]) / pixel for place in places]
    down = [float(place[4] - places[0][4]) / (2.0 / 47) for place in places]
    assert abs(across[1] - 1 / 3) < 0.1 and abs(across[3] - 9.0) < 0.5 and abs(across[2]) < 0.02
    assert abs(down[2] - 1 / 3) < 0.1 and abs(down[1]) < 0.02


def test_places_can_be_learnt() -> None:
    """A linear layer on the points tells where a spot is to a tenth of a pixel after a few steps, at places not seen."""
    torch.manual_seed(0)
    points, layer = Keypoints(8), torch.nn.Linear(16, 2)
    optimiser = torch.optim.Adam([*points.parameters(), *layer.parameters()], 3e-3)
    for _ in range(150):
        wanted = torch.rand(16, 2) * torch.tensor([40.0, 24.0]) + 12.0
        pictures = torch.cat([spot(float(x), float(y)) for x, y in wanted])
        loss = (layer(points(pictures)) * 32.0 + 30.0 - wanted).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        found = layer(points(torch.cat([spot(21.3, 17.8), spot(40.6, 30.1)]))) * 32.0 + 30.0
    assert (found - torch.tensor([[21.3, 17.8], [40.6, 30.1]])).abs().max() < 1.0
