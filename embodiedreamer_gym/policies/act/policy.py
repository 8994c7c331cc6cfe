"""A trained ACT network as a policy: it returns actions in the environment's units, and is stored in a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.files import read_json, write_json
from embodiedreamer_gym.learning.checkpoint import read_state, write_state
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.network import Act
from embodiedreamer_gym.policies.act.statistics import Statistics

CONFIG, WEIGHTS = "config.json", "weights.pt"
KIND = "embodiedreamer_act"


class ActPolicy:
    """Actions (B, k, m) for a batch {"agent_pos": (B, n), "pixels": {camera: (B, H, W, 3) uint8}}.

    action_size (m) and chunk (k): as for every policy; cameras: names of the cameras whose pictures it takes.
    """

    def __init__(self, network: Act) -> None:
        self.network = network.eval()
        self.action_size, self.chunk = network.config.action_size, network.config.chunk
        self.cameras = network.config.cameras

    def __repr__(self) -> str:
        return f"ActPolicy({self.network!r})"

    def __call__(self, batch: Mapping[str, Any]) -> np.ndarray:
        """Actions (B, k, m) float32 in the environment's units.

        Raises: PolicyError for a batch of other cameras or sizes.
        """
        self.network.eval()
        with torch.inference_mode():
            return self.network.denormalise(self.network.mean(batch)).cpu().numpy()

    def save(self, folder: str | Path) -> Path:
        """Write config.json and weights.pt into a folder; returns the folder.

        Raises: PolicyError if they cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        weights = {name: value.cpu() for name, value in self.network.state_dict().items()}
        write_state(weights, folder / WEIGHTS, PolicyError)
        write_json({"type": KIND, "config": self.network.config.as_dict()}, folder / CONFIG, PolicyError)
        return folder

    @staticmethod
    def load(folder: str | Path, device: str = "cpu") -> ActPolicy:
        """The policy that `save` or a training wrote.

        Raises: PolicyError if it is missing or damaged.
        """
        folder = Path(folder)
        data = read_config(folder)
        if data.get("type") != KIND:
            raise PolicyError(
                f"{folder / CONFIG} does not belong to an ACT policy of this package; its type is {data.get('type')!r}."
            )
        config = ActConfig.of(data.get("config") or {})
        damaged = PolicyError(
            f"{folder / WEIGHTS} holds no weights that fit {CONFIG}; it is damaged or belongs to another policy."
        )
        state = read_state(folder / WEIGHTS, damaged)
        network = Act(config, Statistics.of(state))
        try:
            network.load_state_dict(state)
        except RuntimeError as error:
            raise damaged from error
        return ActPolicy(network.to(device))


def read_config(folder: Path) -> dict[str, Any]:
    """The JSON object in a policy's config.json.

    Raises: PolicyError if it is missing or no JSON object.
    """
    if not folder.is_dir():
        raise PolicyError(f"policy {folder} is not a folder; give one that `embodiedreamer policy train` wrote.")
    if not (folder / CONFIG).is_file():
        raise PolicyError(f"{folder} is not a policy: its {CONFIG} is missing.")
    data = read_json(folder / CONFIG, PolicyError, "configuration")
    if not isinstance(data, dict):
        raise PolicyError(f"{folder / CONFIG} must be a JSON object with the key 'type'.")
    return data
