"""Where policies come from."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies import Policy, load_policy
from embodiedreamer_gym.policies.act import Act, ActPolicy
from embodiedreamer_gym.policies.protocol import predict
from tests.policies.act.test_network import a_batch
from tests.policies.act.tiny import CONFIG

MODULE = """
import numpy as np

class Still:
    action_size, chunk = 2, 1
    def __call__(self, batch):
        return np.zeros((len(batch["agent_pos"]), 1, 2), np.float32)

def make():
    return Still()

def broken():
    return lambda batch: batch

number = 3

class Huge(Still):
    chunk = 10**12

class Words(Still):
    action_size = "two"

class Cameras(Still):
    cameras = 5

class Nan(Still):
    def __call__(self, batch):
        return np.full((1, 1, 2), np.nan)

def leaves():
    raise SystemExit(3)

def fails():
    raise RuntimeError("no weights")
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "still_policy.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "still_policy", raising=False)
    return "still_policy"


def test_a_folder_of_ours(tmp_path: Path) -> None:
    policy = ActPolicy(Act(CONFIG))
    found = load_policy(str(policy.save(tmp_path)))
    assert isinstance(found, Policy)
    np.testing.assert_array_equal(found(a_batch()), policy(a_batch()))


def test_a_function_of_the_users(module: str) -> None:
    policy = load_policy(f"{module}:make")
    assert policy(a_batch(3)).shape == (3, policy.chunk, policy.action_size)


def test_a_class_of_the_users_is_made(module: str) -> None:
    assert load_policy(f"{module}:Still").action_size == 2


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("nowhere", "is neither a folder nor a function"),
        ("os:system('ls')", "is neither a folder nor a function"),
        ("a b:make", "is neither a folder nor a function"),
        ("no_such_module_here:make", "cannot be imported"),
        ("{module}:missing", "cannot be imported"),
        ("{module}:broken", "must be a function without arguments"),
        ("{module}:Huge", "must be a function without arguments"),
        ("{module}:Words", "must be a function without arguments"),
        ("{module}:Cameras", "must be a function without arguments"),
        ("{module}:leaves", "cannot be created: SystemExit"),
        ("{module}:number", "must be a function without arguments"),
        ("{module}:fails", "cannot be created: RuntimeError: no weights"),
    ],
)
def test_what_is_no_policy(module: str, spec: str, said: str) -> None:
    with pytest.raises(PolicyError, match=said):
        load_policy(spec.format(module=module))


def test_actions_that_are_not_finite_are_refused(module: str) -> None:
    with pytest.raises(PolicyError, match="not finite"):
        predict(load_policy(f"{module}:Nan"), {"agent_pos": np.zeros((1, 3))}, (1, 1, 2))


def test_a_module_of_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "policy_of_this_folder.py").write_text(MODULE)
    (tmp_path / "policy_with_a_slip.py").write_text("def make(:")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [one for one in sys.path if one])
    assert load_policy("policy_of_this_folder:make").action_size == 2
    with pytest.raises(PolicyError, match="cannot be imported: SyntaxError"):
        load_policy("policy_with_a_slip:make")
