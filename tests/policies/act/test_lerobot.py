"""LeRobot's ACT checkpoints: their names and normalisation.

Written from LeRobot's source; LeRobot itself is not run here.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies import load_policy
from embodiedreamer_gym.policies.act import Act, ActConfig
from embodiedreamer_gym.policies.act.lerobot import MEASURED, NAMES, is_lerobot, load_lerobot
from tests.policies.act.test_network import a_batch
from tests.policies.act.test_safetensors import write

OURS = ActConfig(3, 2, ("top", "wrist"), (32, 24), chunk=4, widths=(8, 8, 16, 16), norm="frozen", keypoints=0, width=16, heads=2,
                 feedforward=16, encoders=1, latent=4, latent_encoders=1, dropout=0.1, placed=False)  # fmt: skip
SAVED = {
    "type": "act", "n_obs_steps": 1, "chunk_size": 4, "n_action_steps": 4, "vision_backbone": "resnet18",
    "input_features": {
        "observation.state": {"type": "STATE", "shape": [3]},
        "observation.images.top": {"type": "VISUAL", "shape": [3, 24, 32]},
        "observation.images.wrist": {"type": "VISUAL", "shape": [3, 24, 32]},
    },
    "output_features": {"action": {"type": "ACTION", "shape": [2]}},
    "normalization_mapping": {"VISUAL": "MEAN_STD", "STATE": "MEAN_STD", "ACTION": "MEAN_STD"},
    "dim_model": 16, "n_heads": 2, "dim_feedforward": 16, "n_encoder_layers": 1, "n_decoder_layers": 1, "use_vae": True,
    "latent_dim": 4, "n_vae_encoder_layers": 1, "dropout": 0.1, "replace_final_stride_with_dilation": False,
    "pre_norm": False, "feedforward_activation": "relu", "temporal_ensemble_coeff": None, "kl_weight": 10.0,
}  # fmt: skip
STATISTICS = {
    "observation.state": (torch.tensor([1.0, 2, 3]), torch.tensor([2.0, 2, 4])),
    "action": (torch.tensor([-1.0, 1]), torch.tensor([0.5, 3])),
    "observation.images.top": (torch.full((3, 1, 1), 0.4), torch.full((3, 1, 1), 0.2)),
    "observation.images.wrist": (torch.full((3, 1, 1), 0.6), torch.full((3, 1, 1), 0.3)),
}


def their_weights(network: Act) -> dict[str, torch.Tensor]:
    """A network's weights as LeRobot names them."""
    theirs = {ours: name for name, ours in NAMES.items()}
    found = {}
    for name, value in network.state_dict().items():
        if not name.startswith(MEASURED):
            head = max((ours for ours in theirs if name.startswith(ours)), key=len)
            found["model." + theirs[head] + name.removeprefix(head)] = value
    return found | {"model.vae_encoder_pos_enc": network.latent_positions[None]}


def checkpoint(folder: Path, old: bool = False, change: dict | None = None, weights: dict | None = None) -> Path:
    """A folder as LeRobot writes it; before 0.4 (old) the statistics are among the weights."""
    folder.mkdir(exist_ok=True)
    (folder / "config.json").write_text(json.dumps(SAVED | (change or {})))
    found = their_weights(Act(OURS)) if weights is None else dict(weights)
    if old:
        for name, (mean, std) in STATISTICS.items():
            key = (
                "unnormalize_outputs.buffer_action"
                if name == "action"
                else "normalize_inputs.buffer_" + name.replace(".", "_")
            )
            found |= {f"{key}.mean": mean, f"{key}.std": std}
    else:
        flat = {
            f"{name}.{k}": v for name, pair in STATISTICS.items() for k, v in zip(("mean", "std"), pair, strict=True)
        }
        write(folder / "policy_preprocessor_step_3_normalizer_processor.safetensors", flat)
        steps = [{"registry_name": "to_batch_processor", "config": {}},
                 {"registry_name": "normalizer_processor", "config": {"eps": 1e-8},
                  "state_file": "policy_preprocessor_step_3_normalizer_processor.safetensors"}]  # fmt: skip
        (folder / "policy_preprocessor.json").write_text(json.dumps({"name": "policy_preprocessor", "steps": steps}))
    write(folder / "model.safetensors", found)
    return folder


@pytest.mark.parametrize("old", [False, True])
def test_the_same_network_comes_out(tmp_path: Path, old: bool) -> None:
    policy, own = load_policy(checkpoint(tmp_path, old)), Act(OURS).eval()
    assert (policy.cameras, policy.chunk, policy.action_size) == (("top", "wrist"), 4, 2)
    batch = a_batch(cameras=("top", "wrist"))
    normal = {"agent_pos": (batch["agent_pos"] - [1, 2, 3]) / [2, 2, 4], "pixels": batch["pixels"]}
    own.pixel_mean[:], own.pixel_scale[:] = torch.tensor([[0.4], [0.6]]), torch.tensor([[0.2], [0.3]])
    with torch.no_grad():
        expected = own.mean(normal).numpy() * [0.5, 3] + [-1, 1]
    np.testing.assert_allclose(policy(batch), expected, atol=1e-4)


def test_the_papers_sizes_are_lerobots_defaults(tmp_path: Path) -> None:
    """The names and shapes of lerobot/act_aloha_sim_transfer_cube_human, by LeRobot's source."""
    shapes = {name: tuple(value.shape) for name, value in their_weights(Act(OURS.with_(chunk=100))).items()}
    for name, shape in {
        "model.vae_encoder_cls_embed.weight": (1, 16),
        "model.vae_encoder_pos_enc": (1, 102, 16),
        "model.vae_encoder_latent_output_proj.weight": (8, 16),
        "model.backbone.layer2.0.downsample.1.running_var": (8,),
        "model.encoder.layers.0.self_attn.in_proj_weight": (48, 16),
        "model.decoder.layers.0.multihead_attn.out_proj.bias": (16,),
        "model.decoder.norm.weight": (16,),
        "model.encoder_1d_feature_pos_embed.weight": (2, 16),
        "model.encoder_img_feat_input_proj.weight": (16, 16, 1, 1),
        "model.decoder_pos_embed.weight": (100, 16),
        "model.action_head.bias": (2,),
    }.items():
        assert shapes[name] == shape


def test_without_the_cvae(tmp_path: Path) -> None:
    """LeRobot then keeps the token of the latent, and drops the CVAE's encoder."""
    weights = {k: v for k, v in their_weights(Act(OURS)).items() if not k.startswith("model.vae_encoder")}
    one = load_lerobot(checkpoint(tmp_path / "a", change={"use_vae": False}, weights=weights))
    two = load_lerobot(checkpoint(tmp_path / "b"))
    batch = a_batch(cameras=("top", "wrist"))
    np.testing.assert_array_equal(one(batch), two(batch))


def test_min_max(tmp_path: Path) -> None:
    folder = checkpoint(
        tmp_path, change={"normalization_mapping": {**SAVED["normalization_mapping"], "ACTION": "MIN_MAX"}}
    )
    flat = {f"{name}.{k}": v for name, pair in STATISTICS.items() for k, v in zip(("mean", "std"), pair, strict=True)}
    flat |= {"action.min": torch.tensor([-2.0, 0]), "action.max": torch.tensor([2.0, 10])}
    write(folder / "policy_preprocessor_step_3_normalizer_processor.safetensors", flat)
    network = load_lerobot(folder).network
    np.testing.assert_allclose(network.denormalise(torch.tensor([[-1.0, -1], [1, 1]])), [[-2, 0], [2, 10]], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vision_backbone": "resnet50"}, "vision_backbone is 'resnet50', but only 'resnet18'"),
        ({"feedforward_activation": "gelu"}, "feedforward_activation"),
        ({"dim_model": 32}, "does not fit its config"),
        ({"n_decoder_layers": 2}, "does not fit its config.*'decoder.layers.1"),
        ({"input_features": {"observation.environment_state": {"type": "ENV", "shape": [3]}}}, "inputs must be"),
        ({"normalization_mapping": {"STATE": "QUANTILES"}}, "no statistics of observation.state"),
    ],
)
def test_what_cannot_be_built_is_refused(tmp_path: Path, change: dict, said: str) -> None:
    with pytest.raises(PolicyError, match=said):
        load_lerobot(checkpoint(tmp_path, change=change))


def test_damaged_checkpoints(tmp_path: Path) -> None:
    folder = checkpoint(tmp_path)
    assert is_lerobot(folder)
    (folder / "policy_preprocessor.json").write_text("[]")
    with pytest.raises(PolicyError, match="not a LeRobot preprocessor"):
        load_lerobot(folder)
    weights = their_weights(Act(OURS))
    for broken in (
        {},
        {k: v for k, v in weights.items() if "action_head.bias" not in k},
        weights | {"model.more": torch.ones(1)},
    ):
        with pytest.raises(PolicyError, match="does not fit"):
            load_lerobot(checkpoint(tmp_path, weights=broken))


@pytest.mark.parametrize(
    "change",
    [
        {"input_features": [1]}, {"output_features": {"action": {}}}, {"chunk_size": "many"}, {"dim_model": 10**9},
        {"n_encoder_layers": 10**9}, {"dropout": None}, {"normalization_mapping": 3},
    ],
)  # fmt: skip
def test_a_configuration_of_rubbish_is_refused(tmp_path: Path, change: dict) -> None:
    with pytest.raises(PolicyError):
        load_lerobot(checkpoint(tmp_path, change=change))
