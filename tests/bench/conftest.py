"""A small set of hidden cases, made once."""

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from embodiedreamer_gym.bench.cases import make_cases
from embodiedreamer_gym.bench.score import read_truth


class Made:
    """Cases, their truth, and the SHA-256 that was printed."""

    def __init__(self, folder: Path) -> None:
        self.cases, self.truth = folder / "cases", folder / "truth"
        tiers, observations = ("none", "single", "subset"), ("effort", "no_command")
        self.digest = make_cases(self.cases, self.truth, 4, 2, tiers, observations, seconds=1.5)
        self.hidden = read_truth(self.truth)[0]

    def folder(self, case: str) -> Path:
        return self.cases / "cases" / case


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Made:
    return Made(tmp_path_factory.mktemp("bench"))
