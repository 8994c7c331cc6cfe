"""Transformer layers that add positions to queries and keys, as DETR does, and sine embeddings of positions."""

from __future__ import annotations

import math

import torch
from torch import nn

from embodiedreamer_gym.policies.act.config import ActConfig

TEMPERATURE = 10_000.0


def sine_1d(count: int, width: int) -> torch.Tensor:
    """Embeddings (count, width) of positions. Source: Vaswani et al., Attention Is All You Need, 2017, section 3.5."""
    angles = torch.arange(count)[:, None] / TEMPERATURE ** (torch.arange(0, width, 2) / width)
    return torch.stack([angles.sin(), angles.cos()], -1).flatten(1)


def sine_2d(height: int, width: int, size: int) -> torch.Tensor:
    """Embeddings (height * width, size) of a feature map's positions: half for the row, half for the column, to 2 pi.

    Source: Carion et al., End-to-End Object Detection with Transformers, 2020, where positions start at 1.
    """
    scale = TEMPERATURE ** (torch.arange(0, size // 2, 2) / (size // 2))
    parts = []
    for count in (height, width):
        angles = 2 * math.pi * (torch.arange(1, count + 1) / (count + 1e-6))[:, None] / scale
        parts.append(torch.stack([angles.sin(), angles.cos()], -1).flatten(1))
    rows, columns = parts
    both = [rows[:, None].expand(-1, width, -1), columns[None].expand(height, -1, -1)]
    return torch.cat(both, -1).flatten(0, 1)


class EncoderLayer(nn.Module):
    """Self-attention and two linear layers, each with a residual connection."""

    def __init__(self, c: ActConfig) -> None:
        super().__init__()
        self.self_attn = nn.MultiheadAttention(c.width, c.heads, c.dropout, batch_first=True)
        self.linear1, self.linear2 = nn.Linear(c.width, c.feedforward), nn.Linear(c.feedforward, c.width)
        self.norm1, self.norm2 = nn.LayerNorm(c.width), nn.LayerNorm(c.width)
        self.dropout, self.pre_norm = nn.Dropout(c.dropout), c.pre_norm

    def forward(self, x: torch.Tensor, position: torch.Tensor, padding: torch.Tensor | None = None) -> torch.Tensor:
        """Tokens (B, T, d) with positions (T, d); padding (B, T) is True where there is no token."""
        y = self.norm1(x) if self.pre_norm else x
        at = y + position
        x = x + self.dropout(self.self_attn(at, at, y, key_padding_mask=padding, need_weights=False)[0])
        x = x if self.pre_norm else self.norm1(x)
        y = self.norm2(x) if self.pre_norm else x
        x = x + self.dropout(self.linear2(self.dropout(torch.relu(self.linear1(y)))))
        return x if self.pre_norm else self.norm2(x)


class Encoder(nn.Module):
    """Encoder layers in sequence."""

    def __init__(self, c: ActConfig, layers: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(c) for _ in range(layers))
        self.norm = nn.LayerNorm(c.width) if c.pre_norm else nn.Identity()

    def forward(self, x: torch.Tensor, position: torch.Tensor, padding: torch.Tensor | None = None) -> torch.Tensor:
        """Tokens (B, T, d) with positions (T, d)."""
        for layer in self.layers:
            x = layer(x, position, padding)
        return self.norm(x)


class DecoderLayer(nn.Module):
    """Self-attention of queries, attention to the memory, and two linear layers, each with a residual connection."""

    def __init__(self, c: ActConfig) -> None:
        super().__init__()
        self.self_attn = nn.MultiheadAttention(c.width, c.heads, c.dropout, batch_first=True)
        self.multihead_attn = nn.MultiheadAttention(c.width, c.heads, c.dropout, batch_first=True)
        self.linear1, self.linear2 = nn.Linear(c.width, c.feedforward), nn.Linear(c.feedforward, c.width)
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(c.width) for _ in range(3))
        self.dropout, self.pre_norm = nn.Dropout(c.dropout), c.pre_norm

    def forward(
        self, x: torch.Tensor, query: torch.Tensor, memory: torch.Tensor, position: torch.Tensor, alike: bool = False
    ) -> torch.Tensor:
        """Queries (B, k, d), positions (k, d); memory (B, T, d), positions (T, d); alike: all queries are the same."""
        y = self.norm1(x) if self.pre_norm else x
        if alike and not (self.training and self.dropout.p):
            x = x + self._of_alike(y[:1, :1])
        else:
            x = x + self.dropout(self.self_attn(y + query, y + query, y, need_weights=False)[0])
        x = x if self.pre_norm else self.norm1(x)
        y = self.norm2(x) if self.pre_norm else x
        x = x + self.dropout(self.multihead_attn(y + query, memory + position, memory, need_weights=False)[0])
        x = x if self.pre_norm else self.norm2(x)
        y = self.norm3(x) if self.pre_norm else x
        x = x + self.dropout(self.linear2(self.dropout(torch.relu(self.linear1(y)))))
        return x if self.pre_norm else self.norm3(x)

    def _of_alike(self, value: torch.Tensor) -> torch.Tensor:
        """Self-attention if all values equal this one (1, 1, d): the attention weights do not matter."""
        own, width = self.self_attn, value.shape[-1]
        seen = nn.functional.linear(value, own.in_proj_weight[2 * width :], own.in_proj_bias[2 * width :])
        return own.out_proj(seen)


class Decoder(nn.Module):
    """Decoder layers in sequence, then a normalisation."""

    def __init__(self, c: ActConfig) -> None:
        super().__init__()
        self.layers = nn.ModuleList(DecoderLayer(c) for _ in range(c.decoders))
        self.norm = nn.LayerNorm(c.width)

    def forward(self, query: torch.Tensor, memory: torch.Tensor, position: torch.Tensor) -> torch.Tensor:
        """Output (B, k, d) for queries with positions (k, d) and memory (B, T, d) with positions (T, d)."""
        x = torch.zeros(len(memory), *query.shape, dtype=memory.dtype, device=memory.device)
        for number, layer in enumerate(self.layers):
            x = layer(x, query, memory, position, alike=number == 0)
        return self.norm(x)
