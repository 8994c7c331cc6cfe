"""A policy's folder: written, read back, refused where it is damaged; temporal ensembling."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.act import Act, ActPolicy, TemporalEnsemble
from embodiedreamer_gym.policies.act.statistics import Statistics
from tests.policies.act.test_network import a_batch
from tests.policies.act.tiny import CONFIG


def a_policy(**changes) -> ActPolicy:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    config = CONFIG.with_(**changes)
    measured = Statistics.measure([rng.normal(2, 3, (20, 3))], [rng.normal(-1, 2, (20, 2))], len(config.cameras))
    return ActPolicy(Act(config, measured))


def test_it_comes_back_as_it_was(tmp_path: Path) -> None:
    policy = a_policy(latent=4, cameras=("head", "left"))
    batch = a_batch(cameras=("head", "left"))
    back = ActPolicy.load(policy.save(tmp_path / "new" / "folder"))
    np.testing.assert_array_equal(back(batch), policy(batch))
    assert (back.action_size, back.chunk, back.cameras) == (2, 4, ("head", "left"))
    assert sorted(p.name for p in (tmp_path / "new" / "folder").iterdir()) == ["config.json", "weights.pt"]


def test_actions_are_in_the_environments_units() -> None:
    policy, batch = a_policy(), a_batch()
    actions = policy(batch)
    assert actions.shape == (2, 4, 2) and actions.dtype == np.float32
    with torch.no_grad():
        normalised = policy.network.mean(batch)
    np.testing.assert_allclose(policy.network.normalise(torch.from_numpy(actions)), normalised, atol=1e-5)


def test_what_is_no_policy_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="is not a folder"):
        ActPolicy.load(tmp_path / "nowhere")
    with pytest.raises(PolicyError, match=r"its config\.json is missing"):
        ActPolicy.load(tmp_path)
    a_policy().save(tmp_path)
    data = json.loads((tmp_path / "config.json").read_text())
    for broken, said in (
        ([1], "JSON object"),
        ({**data, "type": "diffusion"}, "type is 'diffusion'"),
        ({**data, "config": {**data["config"], "action_size": 14}}, "action_mean of the policy"),
    ):
        (tmp_path / "config.json").write_text(json.dumps(broken))
        with pytest.raises(PolicyError, match=said):
            ActPolicy.load(tmp_path)
    (tmp_path / "config.json").write_text(json.dumps(data))
    (tmp_path / "weights.pt").write_bytes((tmp_path / "weights.pt").read_bytes()[:100])
    with pytest.raises(PolicyError, match="damaged"):
        ActPolicy.load(tmp_path)


class Counts:
    """Says in each chunk which query it was, and which step it is about."""

    action_size, chunk, cameras = 2, 3, ("head",)

    def __init__(self) -> None:
        self.queries = 0

    def __call__(self, batch) -> np.ndarray:
        self.queries += 1
        ahead = np.arange(self.queries - 1.0, self.queries + 2)
        return np.stack([np.full(3, self.queries), ahead], 1)[None].astype(np.float32)


def test_an_ensemble_averages_what_was_said_about_this_step() -> None:
    ensemble = TemporalEnsemble(Counts(), decay=0.5)
    said = np.array([ensemble({})[0, 0] for _ in range(5)])
    np.testing.assert_allclose(said[:, 1], np.arange(5.0), atol=1e-6)  # all words are about this step
    weights = np.exp(-0.5 * np.arange(3))
    assert said[0, 0] == 1.0
    assert said[4, 0] == pytest.approx(weights @ [3, 4, 5] / weights.sum())  # the oldest counts most
    assert ensemble.chunk == 1 and ensemble.cameras == ("head",)


def test_an_ensemble_forgets() -> None:
    policy = Counts()
    ensemble = TemporalEnsemble(policy)
    ensemble({})
    ensemble.reset()
    policy.queries = 0
    assert ensemble({})[0, 0, 0] == 1.0
    with pytest.raises(PolicyError, match="decay"):
        TemporalEnsemble(policy, float("nan"))
