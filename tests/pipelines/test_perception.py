"""Measuring the perception errors of a policy on the photos of the shipped bench."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.pipelines.perception import measure_perception
from embodiedreamer_gym.pipelines.policy_env import policy_world
from embodiedreamer_gym.vis_aligner import load_bank
from embodiedreamer_gym.wrappers import PerceptionErrors, PerceptionErrorWrapper


class Brightness:
    """Every action is the brightness of the picture, 0 .. 1, times `gain`."""

    action_size, chunk, cameras, picture_size = 14, 3, ("head",), (128, 96)

    def __init__(self, gain: float = 1.0) -> None:
        self.gain, self.resets = gain, 0

    def reset(self) -> None:
        self.resets += 1

    def __call__(self, batch: Mapping[str, Any]) -> np.ndarray:
        level = self.gain * batch["pixels"]["head"].mean(axis=(1, 2, 3)) / 255
        return np.tile(level[:, None, None], (1, self.chunk, self.action_size)).astype(np.float32)


def test_errors_are_the_differences_between_photos_and_pictures_composed_from_the_other_photos() -> None:
    bank = load_bank("lab").of(["cup", "mat"])
    policy = Brightness()
    errors = measure_perception(policy, "PutCupOnMat")
    assert errors.actions.shape == errors.errors.shape == (len(bank.entries), 3, 14)
    photos = np.array([entry.frame.mean() / 255 for entry in bank.entries])
    assert np.allclose((errors.actions + errors.errors)[:, 0, 0], photos, atol=1e-6)
    assert 0 < np.abs(errors.errors).max() < 0.05  # composed pictures are nearly as bright
    assert policy.resets >= 2 * len(bank.entries)


def test_a_policy_that_ignores_its_pictures_has_no_errors() -> None:
    assert not measure_perception(Brightness(0.0), "GrabPaperCup").errors.any()


def test_policies_with_other_cameras_are_refused() -> None:
    policy: Any = SimpleNamespace(action_size=14, chunk=3, cameras=("left_wrist",))
    with pytest.raises(PolicyError, match="only for policies with the camera head"):
        measure_perception(policy, "PutCupOnMat")


def test_the_command_measures_and_an_evaluation_uses_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "errors.npz"
    policy = f"{__name__}:Brightness"
    assert (
        main(["policy", "perception", "--policy", policy, "--task", "GrabPaperCup-v0", "--out", str(out), "--quiet"])
        == 0
    )
    assert "rms, one value for each photo; 1e-3 of an action's unit" in capsys.readouterr().out
    assert len(PerceptionErrors.load(out).size) == 8
    env = policy_world(Brightness(), "GrabPaperCup", perception=str(out), engine="mujoco")
    assert isinstance(env, PerceptionErrorWrapper) and env.unwrapped.engine.name == "mujoco"
    env.close()
    for wrong in ({"envs": 2}, {"chunks": False}):
        with pytest.raises(PolicyError, match="one environment that takes chunks"):
            policy_world(Brightness(), "GrabPaperCup", perception=str(out), **wrong)
