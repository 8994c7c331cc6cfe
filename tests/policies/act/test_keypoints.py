"""Places in pictures, to fractions of a pixel."""

from __future__ import annotations

import torch

from embodiedreamer_gym.policies.act.keypoints import Keypoints


def spot(x: float, y: float) -> torch.Tensor:
    """A bright disc (1, 3, 48, 64) around a place in pixels."""
    rows, columns = torch.meshgrid(torch.arange(48.0), torch.arange(64.0), indexing="ij")
    return torch.exp(-((rows - y) ** 2 + (columns - x) ** 2) / 8.0).expand(1, 3, -1, -1)


def test_a_point_moves_with_what_it_finds() -> None:
    """By whole pixels as far as the spot, and by fractions of one too, across and down."""
    torch.manual_seed(0)
    points = Keypoints(4)
    with torch.no_grad():
        points.filters[0].weight.abs_()
        points.filters[0].bias.zero_()
        points.filters[2].weight.abs_()
        points.sharpness.fill_(0.7)  # the spot alone counts, and all of it
        moves = ((0.0, 0.0), (1 / 3, 0.0), (0.0, 1 / 3), (9.0, 0.0))
        places = [points(spot(30.0 + dx, 20.0 + dy))[0] for dx, dy in moves]
    across = [float(place[0] - places[0][0]) * 63 / 2 for place in places]
    down = [float(place[4] - places[0][4]) * 47 / 2 for place in places]
    assert 0.1 < across[1] < 0.5 and abs(across[3] - 9.0) < 0.01 and abs(across[2]) < 0.01
    assert 0.1 < down[2] < 0.5 and abs(down[1]) < 0.01


def test_places_can_be_learnt() -> None:
    """Which of two colours counts, and a linear layer on the points, after a few steps: to a pixel at places not seen."""
    torch.manual_seed(0)
    points, layer = Keypoints(8), torch.nn.Linear(16, 2)
    optimiser = torch.optim.Adam([*points.parameters(), *layer.parameters()], 1e-2)

    def pictures(wanted: torch.Tensor) -> torch.Tensor:
        """A red spot in the place that is wanted, and a blue one anywhere."""
        other = torch.rand(len(wanted), 2) * torch.tensor([40.0, 24.0]) + 12.0
        red, blue = torch.tensor([1.0, 0.0, 0.0])[:, None, None], torch.tensor([0.0, 0.0, 1.0])[:, None, None]
        return torch.cat(
            [spot(*a) * red + spot(*b) * blue for a, b in zip(wanted.tolist(), other.tolist(), strict=True)]
        )

    for _ in range(150):
        wanted = torch.rand(8, 2) * torch.tensor([40.0, 24.0]) + 12.0
        loss = (layer(points(pictures(wanted))) * 32.0 + 30.0 - wanted).abs().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    wanted = torch.tensor([[21.3, 17.8], [40.6, 30.1], [33.3, 14.9]])
    with torch.no_grad():
        found = layer(points(pictures(wanted))) * 32.0 + 30.0
    assert (found - wanted).abs().mean() < 1.0


def test_answers_are_those_of_the_filters_as_convolutions() -> None:
    torch.manual_seed(0)
    points, pictures = Keypoints(4), torch.rand(3, 3, 12, 16)
    with torch.no_grad():
        answers = points._answers(pictures.transpose(0, 1).flatten(1)).unflatten(1, (3, -1)).transpose(0, 1)
        torch.testing.assert_close(answers, points.filters(pictures).flatten(2))
