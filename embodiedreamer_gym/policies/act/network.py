"""The action chunking transformer: pictures and state in, a chunk of actions out."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, cast

import numpy as np
import torch
from torch import nn

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.image_size import scaled
from embodiedreamer_gym.policies.act.keypoints import Keypoints
from embodiedreamer_gym.policies.act.mlp_head import MlpHead
from embodiedreamer_gym.policies.act.object_pose_head import POSE_SIZE, ObjectPoseHead
from embodiedreamer_gym.policies.act.resnet import ResNet
from embodiedreamer_gym.policies.act.samples import Samples
from embodiedreamer_gym.policies.act.statistics import Statistics
from embodiedreamer_gym.policies.act.transformer import Decoder, Encoder, sine_1d, sine_2d

# arrays or tensors: agent_pos (B, n), and pixels {camera: (B, H, W, 3) uint8} or object_poses (B, numbers)
Batch = Mapping[str, Any]
OLD_NAMES = {"eyes.": "object_pose_heads.", "direct.": "mlp_head.", ".seen_": ".pose_"}  # in weights of version 0.1


def current_names(state: Mapping[str, Any]) -> dict[str, Any]:
    """Weights, also those of version 0.1, under their current names."""
    renamed = {}
    for name, value in state.items():
        for old, new in OLD_NAMES.items() if name.startswith(("eyes.", "direct.")) else ():
            name = name.replace(old, new, 1)
        renamed[name] = value
    return renamed


class Act(nn.Module):
    """An ACT network; it takes batches in the environment's units and returns normalised actions.

    Source: Zhao et al., Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware, 2023, section IV.
    """

    positions: torch.Tensor
    latent_positions: torch.Tensor

    def __init__(self, config: ActConfig, statistics: Statistics | None = None, seed: int = 0) -> None:
        super().__init__()
        self.config = config
        with torch.random.fork_rng(devices=[]):  # keeps the caller's random state
            torch.manual_seed(seed)
            self._build(config)
        self.register_buffer("latent_positions", sine_1d(2 + config.chunk, config.width), persistent=False)
        self.statistics = Statistics.neutral(config) if statistics is None else statistics
        for name, expected in vars(Statistics.neutral(config)).items():
            given = tuple(getattr(self.statistics, name).shape)
            if given != tuple(expected.shape):
                raise PolicyError(f"{name} of the policy's statistics has shape {given}, not {tuple(expected.shape)}.")
        self.statistics.register(self)

    def _build(self, c: ActConfig) -> None:
        """Make the layers."""
        self.object_pose_heads = None
        if c.objects:
            self.object_pose_heads = nn.ModuleList([ObjectPoseHead(len(c.objects)) for _ in c.cameras])
        if c.latent:
            self.latent_encoder = Encoder(c, c.latent_encoders)
            self.latent_token = nn.Embedding(1, c.width)
            self.latent_state, self.latent_action = nn.Linear(c.state_size, c.width), nn.Linear(c.action_size, c.width)
            self.latent_head = nn.Linear(c.width, 2 * c.latent)
        if c.kind == "object_pose":
            self.mlp_head = MlpHead(c.state_size + c.latent + POSE_SIZE * len(c.objects) * len(c.cameras), c)
        else:
            self._build_transformer(c)

    def _build_transformer(self, c: ActConfig) -> None:
        """Make the layers from pictures to a chunk."""
        self.backbone = ResNet(c.widths, c.norm)
        self.picture = nn.Conv2d(c.widths[-1], c.width, 1)
        self.keypoints = nn.ModuleList([Keypoints(c.keypoints) for _ in c.cameras]) if c.keypoints else None
        self.places = nn.Linear(2 * c.keypoints * len(c.cameras), c.width) if c.keypoints else None
        self.state = nn.Linear(c.state_size, c.width)
        self.poses = nn.Linear(POSE_SIZE * len(c.objects) * len(c.cameras), c.width) if c.objects else None
        self.latent = nn.Linear(c.latent, c.width) if c.latent else None
        self.own_positions = nn.Embedding(1 + bool(c.latent) + bool(c.keypoints) + bool(c.objects), c.width)
        self.encoder, self.decoder = Encoder(c, c.encoders), Decoder(c)
        self.queries = nn.Embedding(c.chunk, c.width)
        self.head = nn.Linear(c.width, c.action_size)
        for part in (self.encoder, self.decoder):
            for weights in part.parameters():
                if weights.dim() > 1:
                    nn.init.xavier_uniform_(weights)
        rows, columns = (-(-side // 2 ** (len(c.widths) + 1)) for side in c.image_size[::-1])
        self.register_buffer("positions", sine_2d(rows, columns, c.width), persistent=False)

    @property
    def device(self) -> torch.device:
        """Device of the weights."""
        return self.get_buffer("state_mean").device

    def __repr__(self) -> str:
        c, weights = self.config, sum(p.numel() for p in self.parameters())
        size = f"{c.image_size[0]} x {c.image_size[1]}"
        return f"Act({', '.join(c.cameras)} at {size}, chunk {c.chunk}, {weights / 1e6:.2f} million weights)"

    # ---- actions -----------------------------------------------------------------------------------------------

    def mean(self, batch: Batch) -> torch.Tensor:
        """Normalised actions (B, k, m) of a batch in the environment's units, with the latent z at 0.

        Raises: PolicyError for a batch of other cameras or sizes.
        """
        return self._decode(batch, None)

    def forward(
        self, batch: Batch, actions: torch.Tensor, padding: torch.Tensor, noise: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Normalised actions (B, k, m), and the KL divergence (B,) of z from a standard normal, nats (0 without z).

        actions: normalised (B, k, m), input of the CVAE's encoder; padding: (B, k), True past an episode's end; noise:
        standard normal (B, latent).
        """
        if not self.config.latent or noise is None:
            return self.mean(batch), torch.zeros(len(actions), device=actions.device)
        mu, log_variance = self._encode_latent(self._state(batch), actions, padding)
        divergence = 0.5 * (mu.square() + log_variance.exp() - 1.0 - log_variance).sum(1)
        return self._decode(batch, mu + (0.5 * log_variance).exp() * noise), divergence

    def learn_object_poses(self, samples: Samples, seed: int = 0, progress: ProgressCallback | None = None) -> None:
        """Train the object pose heads, if there are any, on the masks of a set of episodes."""
        for number, head in enumerate(self.object_pose_heads or ()):
            normalise = partial(self._normalised, camera=number)
            pictures, masks = samples.masked_pictures(self.config.cameras[number])
            cast(ObjectPoseHead, head).fit(pictures, masks, normalise, seed, progress, len(samples.states))

    def object_poses(self, pictures: Mapping[str, Any]) -> torch.Tensor:
        """Poses (B, numbers) of the objects in each camera's pictures (B, H, W, 3); no gradient flows through them."""
        pairs = zip(self.object_pose_heads or (), self._pictures(pictures), strict=True)
        return torch.cat([head(one) for head, one in pairs], 1)

    def precompute(self, batch: Batch) -> Batch:
        """The batch with object poses, if the network uses them; they no longer change once their heads are trained.

        For kind `object_pose` the pictures are left out, since only the poses are needed.
        """
        if self.object_pose_heads is None or "object_poses" in batch:
            return batch
        poses = {"agent_pos": batch["agent_pos"], "object_poses": self.object_poses(batch.get("pixels", {})).cpu()}
        return poses if self.config.kind == "object_pose" else {**poses, "pixels": batch["pixels"]}

    def load_state_dict(self, state_dict: Mapping[str, Any], *args: Any, **options: Any) -> Any:
        """Load weights, including those of version 0.1; see `torch.nn.Module.load_state_dict`."""
        return super().load_state_dict(current_names(state_dict), *args, **options)

    def normalise(self, actions: torch.Tensor) -> torch.Tensor:
        """Convert actions (..., m) in the environment's units to normalised ones."""
        return (actions - self.get_buffer("action_mean")) / self.get_buffer("action_scale")

    def denormalise(self, actions: torch.Tensor) -> torch.Tensor:
        """Convert normalised actions (..., m) to the environment's units."""
        return actions * self.get_buffer("action_scale") + self.get_buffer("action_mean")

    # ---- inside ------------------------------------------------------------------------------------------------

    def _state(self, batch: Batch) -> torch.Tensor:
        """Normalised states (B, n)."""
        if "agent_pos" not in batch:
            raise PolicyError(
                f"this policy needs the state (agent_pos), but the batch contains only: {', '.join(batch) or 'none'}."
            )
        state = torch.as_tensor(batch["agent_pos"], dtype=torch.float32, device=self.device)
        if state.dim() != 2 or state.shape[1] != self.config.state_size:
            raise PolicyError(
                f"this policy needs states of {self.config.state_size} numbers, not of the shape {tuple(state.shape)}."
            )
        if not bool(torch.isfinite(state).all()):
            raise PolicyError("a state, agent_pos, is not finite.")
        return (state - self.get_buffer("state_mean")) / self.get_buffer("state_scale")

    def _pictures(self, pictures: Mapping[str, Any]) -> list[torch.Tensor]:
        """Normalised pictures (B, 3, H, W), one for each camera."""
        normalised, (width, height) = [], self.config.image_size
        for number, name in enumerate(self.config.cameras):
            pixels = pictures.get(name)
            if pixels is None:
                names = ", ".join(pictures) or "none"
                raise PolicyError(
                    f"this policy needs pictures of the camera '{name}', but was given only pictures of: {names}."
                )
            if len(pixels.shape) != 4 or pixels.shape[3] != 3 or str(pixels.dtype).removeprefix("torch.") != "uint8":
                raise PolicyError(
                    f"this policy needs pictures (B, H, W, 3) uint8, not {tuple(pixels.shape)} {pixels.dtype} of '{name}'."
                )
            if pixels.shape[1:3] != (height, width):
                pixels = scaled(np.asarray(pixels), (width, height))
            normalised.append(self._normalised(pixels, number))
        return normalised

    def _normalised(self, pixels: Any, camera: int) -> torch.Tensor:
        """Pictures (B, H, W, 3) of a camera, normalised for the layers: (B, 3, H, W)."""
        if isinstance(pixels, np.ndarray):
            pixels = torch.from_numpy(np.require(pixels, requirements=["C", "W"]))
        picture = pixels.to(self.device).permute(0, 3, 1, 2).float() / 255.0
        mean, scale = self.get_buffer("pixel_mean")[camera], self.get_buffer("pixel_scale")[camera]
        return (picture - mean[:, None, None]) / scale[:, None, None]

    def _encode_latent(
        self, state: torch.Tensor, actions: torch.Tensor, padding: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and logarithm of the variance (B, latent) of z, given states and actions."""
        token = self.latent_token.weight.expand(len(state), 1, -1)
        tokens = torch.cat([token, self.latent_state(state)[:, None], self.latent_action(actions)], 1)
        seen = torch.cat([torch.zeros_like(padding[:, :1]).expand(-1, 2), padding], 1)
        out = self.latent_head(self.latent_encoder(tokens, self.latent_positions, seen)[:, 0])
        return out[:, : self.config.latent], out[:, self.config.latent :]

    def _decode(self, batch: Batch, z: torch.Tensor | None) -> torch.Tensor:
        """Normalised actions (B, k, m) of latents (B, latent)."""
        state = self._state(batch)
        if self.config.latent and z is None:
            z = torch.zeros(len(state), self.config.latent, device=state.device)
        poses = None
        if self.object_pose_heads is not None:
            poses = self.precompute(batch)["object_poses"].to(state.device)
        if self.config.kind == "act":
            return self._attend(state, self._pictures(batch.get("pixels", {})), poses, z)
        return self.mlp_head(torch.cat([one for one in (state, poses, z) if one is not None], 1))

    def _attend(
        self, state: torch.Tensor, pictures: list[torch.Tensor], poses: torch.Tensor | None, z: torch.Tensor | None
    ) -> torch.Tensor:
        """Normalised actions (B, k, m) of the transformer for states, pictures (B, 3, H, W), poses and latents."""
        tokens = [self.state(state)[:, None]]
        if self.latent is not None and z is not None:
            tokens.insert(0, self.latent(z)[:, None])
        if self.keypoints is not None and self.places is not None:
            found = [points(one) for points, one in zip(self.keypoints, pictures, strict=True)]
            tokens.append(self.places(torch.cat(found, 1))[:, None])
        if self.poses is not None and poses is not None:
            tokens.append(self.poses(poses)[:, None])
        features = self.picture(self.backbone(torch.cat(pictures))).flatten(2).transpose(1, 2)
        if self.config.placed:
            features = features + self.positions
        tokens += features.chunk(len(pictures))
        positions = torch.cat([self.own_positions.weight, *[self.positions] * len(pictures)])
        memory = self.encoder(torch.cat(tokens, 1), positions)
        return self.head(self.decoder(self.queries.weight, memory, positions))
