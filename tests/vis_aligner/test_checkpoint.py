"""Aligners as files."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from embodiedreamer_gym.errors import VisionError
from embodiedreamer_gym.vis_aligner import load_aligner
from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
from tests.vis_aligner.scenes import episode


def test_a_lean_model_survives_its_file(tmp_path) -> None:
    torch.manual_seed(1)
    network = Lean(LeanConfig((8, 8, 8, 16)))
    torch.nn.init.normal_(network.out.weight, std=0.1)
    model, one = LeanAligner(network, chunk=5), episode()
    path = save_aligner(model, tmp_path)
    again = load_aligner(path)
    assert again.chunk == 5 and [p.name for p in tmp_path.iterdir()] == ["lean.pt"]
    made, before = (m.render([one.references(0)], [one.condition.part(1, 6)])[0] for m in (again, model))
    assert np.abs(made.astype(int) - before).max() <= 2  # half precision


def test_what_is_no_model_is_refused(tmp_path) -> None:
    (tmp_path / "notes.pt").write_text("shopping list")
    torch.save({"kind": "lean", "config": {"widths": [8, 8, 8, 16]}}, tmp_path / "half.pt")
    torch.save({"evil": torch.nn.Linear(2, 2)}, tmp_path / "code.pt")  # would run code when read as a pickle
    for name, says in (("notes.pt", "not a lean model"), ("half.pt", "not a lean model"), ("code.pt", "not a lean model"),
                       ("none.pt", "does not exist")):  # fmt: skip
        with pytest.raises(VisionError, match=says):
            load_aligner(tmp_path / name)
