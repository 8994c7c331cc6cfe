"""LeRobot trains ACT for some steps on a LeRobot set that this package wrote; run it in LeRobot's own environment.

python lerobot_trains.py SET OUT [--steps 20]

OUT/checkpoint is saved by LeRobot (network, configuration, processors); OUT/chunks.npz has observations of the set and
the chunks of actions that LeRobot predicts for them.
"""

from __future__ import annotations

import argparse
import importlib.metadata
from pathlib import Path

import numpy as np
import torch
from lerobot.configs.types import FeatureType
from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.utils import dataset_to_policy_features
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors

CHUNK, BATCH, LOOKED_AT = 20, 4, 8
SIZES = {
    "dim_model": 64,
    "n_heads": 4,
    "dim_feedforward": 128,
    "n_encoder_layers": 2,
    "n_vae_encoder_layers": 2,
    "latent_dim": 8,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", type=int, default=20)
    a = parser.parse_args()
    torch.manual_seed(0)
    meta = LeRobotDatasetMetadata("local/written", root=a.set)
    features = dataset_to_policy_features(meta.features)
    outputs = {name: one for name, one in features.items() if one.type is FeatureType.ACTION}
    inputs = {name: one for name, one in features.items()
              if name == "observation.state" or one.type is FeatureType.VISUAL}  # fmt: skip
    config = ACTConfig(input_features=inputs, output_features=outputs, chunk_size=CHUNK, n_action_steps=CHUNK, device="cpu",
                       pretrained_backbone_weights=None, **SIZES)  # fmt: skip
    policy = ACTPolicy(config)
    before, after = make_pre_post_processors(config, dataset_stats=meta.stats)
    delta = {"action": [k / meta.fps for k in range(CHUNK)]}
    data = LeRobotDataset("local/written", root=a.set, delta_timestamps=delta, video_backend="pyav")
    loader = torch.utils.data.DataLoader(data, BATCH, shuffle=True, generator=torch.Generator().manual_seed(0))
    optimiser, step, losses = torch.optim.AdamW(policy.get_optim_params(), lr=1e-4), 0, []
    policy.train()
    while step < a.steps:
        for batch in loader:
            loss, _ = policy.forward(before(batch))
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
            step += 1
            if step == a.steps:
                break
    for part in (policy, before, after):
        part.save_pretrained(a.out / "checkpoint")
    items = [data[k] for k in np.linspace(0, len(data) - 1, LOOKED_AT).astype(int)]
    # an environment gives a policy integer pixels, so these are rounded before LeRobot uses them
    pictures = {
        name: np.stack([np.round(item[name].numpy() * 255).astype(np.uint8) for item in items])
        for name in meta.video_keys
    }
    states = np.stack([item["observation.state"].numpy() for item in items])
    seen = {name: torch.from_numpy(values).float() / 255 for name, values in pictures.items()}
    with torch.no_grad():
        chunks = after(policy.predict_action_chunk(before({"observation.state": torch.from_numpy(states), **seen})))
    rows = {name: values.transpose(0, 2, 3, 1) for name, values in pictures.items()}
    np.savez(a.out / "chunks.npz", state=states, actions=chunks.numpy(), **rows)
    print(f"lerobot {importlib.metadata.version('lerobot')}: ACT trained for {step} steps on {meta.total_episodes} episodes, "
          f"loss {losses[0]:.2f} to {losses[-1]:.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
