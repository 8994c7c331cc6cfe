"""Configuration of an ACT network: sizes, cameras, chunk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from embodiedreamer_gym.errors import PolicyError

NORMS = ("group", "frozen")
MOST_CAMERAS = 3
MOST_NUMBERS, MOST_LAYERS = 400_000_000, 100  # values in a network (1.6 GB); layers of its transformers


@dataclass(frozen=True)
class ActConfig:
    """Sizes of an action chunking transformer; the defaults train in minutes on a laptop's CPU.

    Raises: PolicyError for sizes from which no network can be built.
    Source: Zhao et al., Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware, 2023, hyperparameters of
    its appendix.
    """

    state_size: int
    """Numbers in a state."""
    action_size: int
    """Numbers in an action."""
    cameras: tuple[str, ...]
    """Names of one to three cameras."""
    image_size: tuple[int, int]
    """Width and height of a picture, pixels; others are scaled to it."""
    chunk: int = 100
    """Actions predicted at once (k)."""
    widths: tuple[int, ...] = (16, 32, 64)
    """Channels of the ResNet's stages, two blocks each; the last stage has 1 / 2^(stages + 1) of the picture's size."""
    norm: str = "group"
    """`group`, or `frozen`: batch normalisation with fixed statistics, as in pretrained weights."""
    keypoints: int = 16
    """Key points in each picture; all of them form one token, in addition to the ResNet's tokens; 0 for none."""
    objects: tuple[str, ...] = ()
    """Objects whose masks the object pose heads learn."""
    transformer: bool = False
    """With objects: True if their poses are a token of the transformer, in addition to the pictures (kind `act`); False
    if the poses and the state are the only inputs of an MLP, without ResNet and transformer (kind `object_pose`)."""
    width: int = 128
    """Width of the transformer, or of the MLP."""
    heads: int = 8
    """Heads of the transformer's attention."""
    feedforward: int = 256
    """Hidden width of the transformer's feed-forward layers, or of the MLP's residual layers."""
    encoders: int = 2
    """Layers of the transformer's encoder, or residual layers of the MLP."""
    decoders: int = 1
    """Layers of the transformer's decoder."""
    latent: int = 0
    """Numbers in the CVAE's z; 0 without a CVAE."""
    latent_encoders: int = 2
    """Layers of the CVAE's encoder."""
    dropout: float = 0.0
    """Fraction of activations dropped in training."""
    pre_norm: bool = False
    """Whether to normalise before attention, not after."""
    placed: bool = True
    """Whether positions are added to the picture tokens themselves; if not, they are added to queries and keys only."""
    source_size: tuple[int, int] | None = None
    """Width and height of the training pictures before scaling, pixels; None if they were not scaled."""

    def __post_init__(self) -> None:
        """Check the values."""
        for field in fields(self):
            if field.type == "int":
                _at_least(field.name, getattr(self, field.name), 0 if field.name in ("latent", "keypoints") else 1)
        for names in (self.cameras, self.objects):
            if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
                raise PolicyError(f"cameras and objects must be names, not {names!r}.")
        for sizes in (self.image_size, self.source_size or (), self.widths):
            if not isinstance(sizes, tuple):
                raise PolicyError(f"image_size, source_size and widths must be whole numbers, not {sizes!r}.")
            for value in sizes:
                _at_least("one of image_size, source_size and widths", value, 1)
        if len(self.image_size) != 2 or len(self.source_size or (1, 1)) != 2 or not self.widths:
            raise PolicyError("image_size must be a width and a height, and widths must have at least one stage.")
        if not 1 <= len(set(self.cameras)) == len(self.cameras) <= MOST_CAMERAS:
            raise PolicyError(
                f"ACT needs one to {MOST_CAMERAS} cameras with different names, not {list(self.cameras)}."
            )
        if self.width % self.heads or self.width % 4:
            raise PolicyError(f"width {self.width} must be a multiple of 4 and of the {self.heads} heads.")
        if self.norm not in NORMS:
            raise PolicyError(f"norm '{self.norm}' is not one of {', '.join(NORMS)}.")
        if self.norm == "group" and any(one % 8 for one in self.widths):
            raise PolicyError(f"widths {list(self.widths)} must be multiples of 8, the channels of a group.")
        if not isinstance(self.dropout, int | float) or not 0 <= self.dropout < 1:
            raise PolicyError(f"dropout {self.dropout!r} is not a share between 0 and 1.")
        if self.numbers > MOST_NUMBERS or self.encoders + self.decoders + self.latent_encoders > MOST_LAYERS:
            raise PolicyError(
                f"an ACT network of these sizes has {self.numbers:.2g} numbers; at most {MOST_NUMBERS:.2g} numbers "
                f"and {MOST_LAYERS} layers are allowed."
            )

    @property
    def kind(self) -> str:
        """`object_pose` for an MLP that takes the objects' poses, else `act`."""
        return "object_pose" if self.objects and not self.transformer else "act"

    @property
    def numbers(self) -> int:
        """Approximate number of values in the network's weights and in one batch's feature maps."""
        c, count = self, 1 + len(self.objects)
        layers = c.encoders + 2 * c.decoders + bool(c.latent) * c.latent_encoders
        cells = c.image_size[0] * c.image_size[1]
        residual = sum(49 * (before + after) * after for before, after in zip((3, *c.widths), c.widths, strict=False))
        ends = (c.state_size + c.action_size + c.latent + 3 * c.chunk + count * 6 * len(c.cameras)) * c.width
        direct = c.width * c.chunk * c.action_size if c.kind == "object_pose" else 0
        return (layers * (4 * c.width + 2 * c.feedforward) * c.width + residual + ends + direct
                + cells * (16 * count + c.keypoints) + cells * c.width // 4 ** (len(c.widths) + 1))  # fmt: skip

    def with_(self, **changes: Any) -> ActConfig:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def small(self, objects: tuple[str, ...] = ()) -> ActConfig:
        """The same inputs with the paper's parts (ResNet, transformer, CVAE), small enough to train on a laptop's CPU.

        objects: their poses, found with masks, are a further input.
        """
        return self.with_(objects=objects, transformer=True, keypoints=0 if objects else self.keypoints, latent=32)

    def paper(self) -> ActConfig:
        """The same inputs with the paper's sizes, about 52 million weights; chunk 100.

        One decoder layer: upstream asks for seven, but returns the first one's output (tonyzhaozh/act, issue 25).
        """
        return self.with_(
            chunk=100, widths=(64, 128, 256, 512), norm="frozen", keypoints=0, objects=(), width=512, heads=8, feedforward=3200, encoders=4,
            decoders=1, latent=32, latent_encoders=4, dropout=0.1, placed=False,
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """The configuration as a JSON-serialisable dictionary."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @staticmethod
    def of(data: Mapping[str, Any]) -> ActConfig:
        """The inverse of `as_dict`.

        Raises: PolicyError for an unknown or a missing key.
        """
        if not isinstance(data, Mapping):
            raise PolicyError("an ACT configuration must be a JSON object.")
        names = [field.name for field in fields(ActConfig)]
        for key in data:
            if key not in names:
                raise PolicyError(f"an ACT configuration has no '{key}'; it has {', '.join(names)}.")
        try:
            values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
            return ActConfig(**values)
        except TypeError as error:
            raise PolicyError(
                f"the ACT configuration is incomplete or has values of the wrong type: {error}."
            ) from error


def _at_least(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise PolicyError(f"{name} is {value!r}, but must be a whole number of at least {least}.")
