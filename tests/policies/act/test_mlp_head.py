"""From what the eyes tell to a chunk."""

from __future__ import annotations

import torch

from embodiedreamer_gym.policies.act.mlp_head import MlpHead
from tests.policies.act.tiny import CONFIG


def test_it_starts_as_a_plane() -> None:
    torch.manual_seed(0)
    net, x = MlpHead(5, CONFIG), torch.randn(7, 5)
    assert net(x).shape == (7, CONFIG.chunk, CONFIG.action_size)
    zero = net(torch.zeros(1, 5))
    torch.testing.assert_close(net(3.0 * x) - zero, 3.0 * (net(x) - zero), atol=1e-5, rtol=1e-4)


def test_it_learns_what_is_no_plane_and_goes_on_beyond_it() -> None:
    """A chunk that bends; and where only one side of a slope was shown, the other side is near the slope."""
    torch.manual_seed(0)
    net = MlpHead(2, CONFIG.with_(width=64, feedforward=64, encoders=2))
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3)

    def truth(x: torch.Tensor) -> torch.Tensor:
        chunk = torch.stack([x[:, 0] + k * x[:, 1].square() for k in range(CONFIG.chunk)], 1)
        return torch.stack([chunk, -chunk], 2)

    for _ in range(400):
        x = 2.0 * torch.rand(64, 2) - 1.0
        loss = (net(x) - truth(x)).abs().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    grid = torch.cartesian_prod(torch.linspace(-0.9, 0.9, 7), torch.linspace(-0.9, 0.9, 7))
    assert float((net(grid) - truth(grid)).abs().mean().detach()) < 0.1
    beyond = torch.tensor([[1.4, 0.3]])
    assert float((net(beyond) - truth(beyond)).abs().max().detach()) < 0.35
