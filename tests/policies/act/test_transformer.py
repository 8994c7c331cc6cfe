"""The transformer's layers."""

from __future__ import annotations

import pytest
import torch

from embodiedreamer_gym.policies.act import ActConfig
from embodiedreamer_gym.policies.act.transformer import DecoderLayer


@pytest.mark.parametrize("pre_norm", [False, True])
def test_queries_that_are_alike_need_no_attention(pre_norm: bool) -> None:
    """The shortcut of the first layer gives what attention gives, the values and their gradients."""
    torch.manual_seed(0)
    config = ActConfig(2, 2, ("head",), (16, 12), chunk=4, width=16, heads=2, feedforward=16, pre_norm=pre_norm)
    layer = DecoderLayer(config)
    for weights in layer.parameters():
        torch.nn.init.normal_(weights, std=0.3)
    x, query, memory, position = torch.zeros(3, 4, 16), torch.rand(4, 16), torch.rand(3, 5, 16), torch.rand(5, 16)
    found = []
    for alike in (False, True):
        layer.zero_grad()
        out = layer(x, query, memory, position, alike)
        out.square().sum().backward()
        gradient = layer.self_attn.out_proj.weight.grad
        assert gradient is not None
        found.append((out.detach(), gradient.clone()))
    torch.testing.assert_close(found[0], found[1])
