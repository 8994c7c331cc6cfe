"""Several processes that train one network together."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import MissingExtraError
from embodiedreamer_gym.learning import processes as module
from embodiedreamer_gym.learning.optimisation import Optimisation
from embodiedreamer_gym.learning.processes import Processes, find_processes

TRAINS = """
import sys, torch
from embodiedreamer_gym.learning.optimisation import Optimisation
from embodiedreamer_gym.learning.processes import find_processes
processes = find_processes("cpu")
torch.manual_seed(0)
network = torch.nn.Linear(3, 1)
optimisation = Optimisation(network.parameters(), 20, 0.1, warm_up=1, clip=1.0, processes=processes)
share = torch.linspace(-1, 1, 12).reshape(4, 3)[processes.index :: processes.count]
for step in range(5):
    optimisation.minimise(torch.mean((network(share) - share.sum(1, keepdim=True)) ** 2), step)
processes.wait()
torch.save(network.state_dict(), f"{sys.argv[1]}/{processes.index}of{processes.count}.pt")
"""


def test_one_process_needs_no_library(monkeypatch) -> None:
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    alone = find_processes("cpu")
    assert alone.first and alone.count == 1 and alone.accelerate is None
    assert alone.mean(torch.tensor(3.0)) == 3.0


def test_several_without_the_library_are_told_what_to_install(monkeypatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.setattr(module.importlib, "import_module", missing)
    with pytest.raises(MissingExtraError, match=r"pip install 'embodiedreamer-gym\[accelerate\]'"):
        find_processes("cpu")


def test_gradients_are_averaged_before_the_step() -> None:
    """A process whose gradient is 1 beside another one whose gradient is 3 goes as one whose gradient is 2."""

    class Beside:
        class utils:
            @staticmethod
            def reduce(value: torch.Tensor, how: str) -> torch.Tensor:
                assert how == "mean"
                return (value + 3.0) / 2

    weight = torch.nn.Parameter(torch.zeros(4))
    optimisation = Optimisation([weight], 10, 0.1, clip=100.0, processes=Processes(0, 2, accelerate=Beside))
    made = optimisation.minimise(weight.sum(), 0)
    assert weight.grad is not None and weight.grad.tolist() == [2.0] * 4
    assert made["gradient"] == pytest.approx(4.0)


@pytest.mark.slow
def test_two_processes_go_as_one_with_both_shares(tmp_path: Path) -> None:
    pytest.importorskip("accelerate", reason="the extra [accelerate] is not installed")
    (tmp_path / "trains.py").write_text(TRAINS)
    env = {k: v for k, v in os.environ.items() if k != "WORLD_SIZE"} | {"OMP_NUM_THREADS": "1"}
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
    for command in ([sys.executable], launch):
        subprocess.run([*command, str(tmp_path / "trains.py"), str(tmp_path)], env=env, check=True, timeout=300)
    alone, *both = (torch.load(tmp_path / f"{name}.pt", weights_only=True) for name in ("0of1", "0of2", "1of2"))
    for weights in both:
        for name, value in alone.items():
            assert np.allclose(weights[name], value, atol=1e-6), name
