"""ACT checkpoints of LeRobot as policies of this package, with their weights renamed.

Source: huggingface/lerobot, src/lerobot/policies/act/{modeling_act,configuration_act}.py and
src/lerobot/processor/normalize_processor.py, whose names and defaults are used here; checked against that source.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.io.files import check_regular, read_json
from embodiedreamer_gym.policies.act.config import ActConfig
from embodiedreamer_gym.policies.act.network import Act
from embodiedreamer_gym.policies.act.policy import ActPolicy, read_config
from embodiedreamer_gym.policies.act.statistics import Statistics

MODEL = "model.safetensors"
PROCESSOR = "policy_preprocessor.json"
STATE, ACTION, PICTURES = "observation.state", "action", "observation.images."
SIZES = {"chunk_size": "chunk", "dim_model": "width", "n_heads": "heads", "dim_feedforward": "feedforward",
         "n_encoder_layers": "encoders", "n_decoder_layers": "decoders", "n_vae_encoder_layers": "latent_encoders",
         "dropout": "dropout", "pre_norm": "pre_norm", "latent_dim": "latent"}  # fmt: skip
FIXED = {"n_obs_steps": 1, "vision_backbone": "resnet18", "replace_final_stride_with_dilation": False,
         "feedforward_activation": "relu"}  # fmt: skip
NAMES = {  # LeRobot's prefix -> ours; the longest that fits is used
    "backbone.": "backbone.",
    "encoder.": "encoder.",
    "decoder.": "decoder.",
    "encoder_robot_state_input_proj.": "state.",
    "encoder_latent_input_proj.": "latent.",
    "encoder_img_feat_input_proj.": "picture.",
    "encoder_1d_feature_pos_embed.": "own_positions.",
    "decoder_pos_embed.": "queries.",
    "action_head.": "head.",
    "vae_encoder.": "latent_encoder.",
    "vae_encoder_cls_embed.": "latent_token.",
    "vae_encoder_robot_state_input_proj.": "latent_state.",
    "vae_encoder_action_input_proj.": "latent_action.",
    "vae_encoder_latent_output_proj.": "latent_head.",
}
COMPUTED = ("vae_encoder_pos_enc",)
MEASURED = ("state_mean", "state_scale", "action_", "pixel_")  # statistics, which are read separately
OLD = {STATE: "normalize_inputs.buffer_observation_state", ACTION: "unnormalize_outputs.buffer_action"}


def is_lerobot(folder: str | Path) -> bool:
    """Whether a folder holds an ACT checkpoint of LeRobot.

    Raises: PolicyError if its config.json cannot be read.
    """
    folder = Path(folder)
    return (folder / MODEL).is_file() and read_config(folder).get("type") == "act"


def load_lerobot(folder: str | Path) -> ActPolicy:
    """The policy of a LeRobot ACT checkpoint: config.json, model.safetensors and, since 0.4, processor statistics.

    Raises: PolicyError if it is damaged, or has an architecture that this package does not build.
    """
    folder = Path(folder)
    data = read_config(folder)
    try:
        config, features = _config(data, folder)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        if isinstance(error, PolicyError):
            raise
        raise PolicyError(
            f"{folder / 'config.json'} is incomplete or has values of the wrong type: {error}."
        ) from error
    weights = read_safetensors(folder / MODEL)
    renamed = {_renamed(name): value.float() for name, value in weights.items() if name.startswith("model.")}
    renamed.pop("", None)
    stages = [renamed[name] for number in range(1, 5) if (name := f"backbone.layer{number}.0.conv1.weight") in renamed]
    config = config.with_(widths=tuple(len(weight) for weight in stages) or config.widths)
    network = Act(config, _statistics(folder, data, weights, features))
    expected = {name: tuple(v.shape) for name, v in network.state_dict().items() if not name.startswith(MEASURED)}
    needed = {name for name in expected if not name.startswith("latent_")}  # the CVAE's encoder: training only
    unfit = sorted((needed - set(renamed)) | (set(renamed) - set(expected)))
    unfit += [name for name in renamed if tuple(renamed[name].shape) != expected.get(name)]
    if unfit:
        raise PolicyError(
            f"{folder / MODEL} does not fit its config.json: '{unfit[0]}' is missing, unexpected or has another size."
        )
    network.load_state_dict(renamed, strict=False)
    return ActPolicy(network)


def read_safetensors(path: str | Path) -> dict[str, torch.Tensor]:
    """Read the tensors of a file, by name.

    Raises: PolicyError if the file is missing, truncated or of another format.
    """
    check_regular(path, PolicyError)
    try:
        return load_file(path)
    except (OSError, SafetensorError, ValueError, RuntimeError) as error:
        raise PolicyError(f"{path} cannot be read as safetensors: {error}.") from error


def _config(data: Mapping[str, Any], folder: Path) -> tuple[ActConfig, list[str]]:
    """The configuration, and the names of the cameras' features."""
    where = folder / "config.json"
    for key, value in FIXED.items():
        if data.get(key, value) != value:
            raise PolicyError(f"{where}: {key} is {data[key]!r}, but only {value!r} is supported.")
    if not isinstance(data.get("normalization_mapping") or {}, Mapping):
        raise PolicyError(f"{where}: normalization_mapping must be an object.")
    inputs, outputs = data.get("input_features") or {}, data.get("output_features") or {}
    pictures = [name for name in inputs if name.startswith(PICTURES)]
    others = [name for name in inputs if name not in (STATE, *pictures)]
    if others or not pictures or STATE not in inputs or ACTION not in outputs:
        raise PolicyError(
            f"{where}: inputs must be {STATE} and {PICTURES}*, the output {ACTION}; found {list(inputs)}."
        )
    shapes = {tuple(inputs[name]["shape"]) for name in pictures}
    if len(shapes) > 1:
        raise PolicyError(
            f"{where}: the pictures of the cameras have different sizes, but one size is needed: {sorted(shapes)}."
        )
    _, height, width = shapes.pop()
    sizes = {ours: data[theirs] for theirs, ours in SIZES.items() if theirs in data}
    paper = ActConfig(int(inputs[STATE]["shape"][0]), int(outputs[ACTION]["shape"][0]),
                      tuple(name.removeprefix(PICTURES) for name in pictures), (int(width), int(height))).paper()  # fmt: skip
    return paper.with_(**sizes), pictures


def _renamed(name: str) -> str:
    """Our name for one of LeRobot's weights; empty for a weight that is computed here."""
    name = name.removeprefix("model.")
    if name in COMPUTED:
        return ""
    for theirs in sorted(NAMES, key=len, reverse=True):
        if name.startswith(theirs):
            return NAMES[theirs] + name.removeprefix(theirs)
    return name


def _statistics(
    folder: Path, data: Mapping[str, Any], weights: Mapping[str, torch.Tensor], pictures: list[str]
) -> Statistics:
    """Means and scales, from the processor's file or, before 0.4, from the weights."""
    modes = data.get("normalization_mapping") or {}
    saved = _processor_state(folder)

    def pair(kind: str, feature: str, old: str) -> tuple[torch.Tensor, torch.Tensor]:
        mode = modes.get(kind, "MEAN_STD")
        one, two = {"MEAN_STD": ("mean", "std"), "MIN_MAX": ("min", "max")}.get(str(mode), ("", ""))
        places = [(saved, feature), (weights, old)]
        for source, name in places:
            if f"{name}.{one}" in source and f"{name}.{two}" in source:
                first, second = (source[f"{name}.{part}"].flatten().float() for part in (one, two))
                return (first, second + 1e-8) if one == "mean" else ((first + second) / 2, (second - first + 1e-8) / 2)
        raise PolicyError(
            f"{folder}: there are no statistics of {feature} for the normalisation {mode}; MEAN_STD and MIN_MAX are supported."
        )

    state, action = pair("STATE", STATE, OLD[STATE]), pair("ACTION", ACTION, OLD[ACTION])
    seen = [pair("VISUAL", name, "normalize_inputs.buffer_" + name.replace(".", "_")) for name in pictures]
    return Statistics(*state, *action, torch.stack([one for one, _ in seen]), torch.stack([two for _, two in seen]))


def _processor_state(folder: Path) -> dict[str, torch.Tensor]:
    """Tensors that the normalisation step of LeRobot's preprocessor saved; empty for older checkpoints."""
    path = folder / PROCESSOR
    if not path.is_file():
        return {}
    data = read_json(path, PolicyError, "preprocessor")
    try:
        steps = data["steps"]
        files = [
            s["state_file"] for s in steps if s.get("registry_name") == "normalizer_processor" and s.get("state_file")
        ]
    except (LookupError, TypeError, AttributeError) as error:
        raise PolicyError(f"{path} is not a LeRobot preprocessor: {error}.") from error
    found: dict[str, torch.Tensor] = {}
    for name in files:
        found |= read_safetensors(folder / Path(str(name)).name)
    return found
