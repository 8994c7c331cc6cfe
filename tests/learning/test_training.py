"""The common trainer: schedule, average, checkpoints that are taken up again, and those that are refused."""

from __future__ import annotations

import os
import zipfile

import pytest
import torch
from torch import nn

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.learning import Training, TrainingSettings, cosine, read_state, write_state
from embodiedreamer_gym.learning import training as module
from embodiedreamer_gym.learning.training import train_in_folder

SETTINGS = TrainingSettings(steps=7, batch=2, learning_rate=1e-2)


class Line(Training):
    """Learns to give twice its input."""

    def __init__(self, settings: TrainingSettings = SETTINGS, size: int = 1) -> None:
        torch.manual_seed(0)
        super().__init__(nn.Linear(size, 1), settings, PolicyError)
        self.size = size

    def loss(self, step: int) -> dict[str, torch.Tensor]:
        generator = torch.Generator().manual_seed(1000 * self.config.seed + step)
        x = torch.rand(self.config.batch, self.size, generator=generator)
        return {"loss": (self.network(x) - 2.0 * x[:, :1]).square().mean()}

    def identity(self) -> dict[str, object]:
        return {"sizes": [self.size]}


def test_the_learning_rate_warms_up_and_falls_to_zero() -> None:
    assert cosine(0, 1000) == pytest.approx(0.01) and cosine(999, 1000) < 1e-5
    assert cosine(500, 1000) == pytest.approx(0.5) and cosine(0, 1000, warm_up=1) == 1.0


def test_an_interrupted_training_gives_the_same_weights(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SAVED_EVERY", 3)
    whole, cut, saved = Line(), Line(), []
    rows: list[float] = []
    whole.run(report=lambda row: rows.append(row["learning_rate"]))

    def stop(row: dict[str, float]) -> None:
        if row["step"] == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_in_folder(cut, tmp_path, stop, lambda: saved.append(cut.step))
    again = Line()
    again.load(tmp_path / "checkpoint.pt")
    assert again.step == 3 and saved == [3] and len(rows) == 7 and rows[0] == pytest.approx(1e-4)
    train_in_folder(again, tmp_path)
    for name in ("averaged", "network"):
        one, two = (getattr(t, name) if name == "averaged" else t.network.state_dict() for t in (whole, again))
        assert all(torch.equal(value, two[key]) for key, value in one.items())
    assert not torch.equal(whole.averaged["weight"], whole.network.state_dict()["weight"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"training": {**vars(SETTINGS), "steps": 8}}, "other settings"),
        ({"sizes": [2]}, "other sizes"),
        ({"training": None}, "damaged"),
        ({"step": "seven"}, "damaged"),
        ({"step": 99}, "damaged"),
        ({"network": {"weight": torch.zeros(1, 1)}}, "damaged"),
        ({"averaged": {"weight": torch.zeros(1, 2), "bias": torch.zeros(1)}}, "damaged"),
        ({"optimiser": {}}, "damaged"),
        ({"optimiser": {"state": {5: {}}, "param_groups": []}}, "damaged"),
        ({"optimiser": {"state": {0: {"step": torch.tensor(1.0), "exp_avg": torch.zeros(9)}}}}, "damaged"),
    ],
)
def test_a_checkpoint_of_something_else_is_refused(tmp_path, change: dict, message: str) -> None:
    path = tmp_path / "checkpoint.pt"
    training = Line()
    training.run(3)
    training.save(path)
    state = read_state(path, PolicyError("no"))
    write_state({**state, **change}, path, PolicyError)
    with pytest.raises(PolicyError, match=message):
        Line().load(path)


def test_what_would_take_more_memory_than_its_file_is_refused(tmp_path) -> None:
    path, wrong = tmp_path / "state.pt", PolicyError("refused")
    write_state({"a": torch.zeros(1).expand(10**9)}, path, PolicyError)
    with pytest.raises(PolicyError, match="refused"):
        read_state(path, wrong)
    torch.save({"a": torch.zeros(1)}, path, _use_new_zipfile_serialization=False)
    with pytest.raises(PolicyError, match="refused"):
        read_state(path, wrong)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("state/data/0", bytes(8 << 20))
    with pytest.raises(PolicyError, match="refused"):
        read_state(path, wrong)
    with pytest.raises(PolicyError, match="cannot be written"):
        write_state({}, tmp_path / "none" / "state.pt", PolicyError)


def test_numbers_are_checked() -> None:
    for change, message in (
        ({"steps": 0}, "steps is 0"),
        ({"average": 2.0}, "average is 2"),
        ({"seed": -1}, "seed is"),
    ):
        with pytest.raises(PolicyError, match=message):
            TrainingSettings(**change).check(PolicyError)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_no_checkpoint(tmp_path) -> None:
    """It is refused without being opened, which would block."""
    os.mkfifo(tmp_path / "state.pt")
    with pytest.raises(ValueError, match="damaged"):
        read_state(tmp_path / "state.pt", ValueError("damaged"))
