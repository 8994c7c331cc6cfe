"""Refit caches that are damaged are refused in one sentence; former argument names work with a warning."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import Where, diagnose, error_breakdown, where
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.errors import CalibrationError
from tests.two_joint_arm import load_arm, record


@pytest.fixture(scope="module")
def question(tmp_path_factory):
    model = load_arm(tmp_path_factory.mktemp("arm"))
    return model, [record(model)], ("payload",)


def test_a_fit_that_was_kept_is_read_again(question, tmp_path) -> None:
    path = tmp_path / "refits.jsonl"
    RefitCache(path, *question).keep("0 effects + payload", np.array([1.0, 2.0]), "linear")
    fit = RefitCache(path, *question).get("0 effects + payload")
    assert fit is not None and fit.hold == "linear" and fit.x.tolist() == [1.0, 2.0]
    assert RefitCache(path, *question).get("another") is None


@pytest.mark.parametrize(
    "change",
    [{"x": [10**400]}, {"x": [float("nan")]}, {"x": [[1.0]]}, {"x": "text"}, {"hold": "never"}, {"fit": []}],
    ids=str,
)
def test_a_line_with_wrong_values_is_refused(change: dict, question, tmp_path) -> None:
    path = tmp_path / "refits.jsonl"
    RefitCache(path, *question).keep("fit", np.array([1.0]), None)
    row = json.loads(path.read_text()) | change
    path.write_text(json.dumps(row) + "\n")
    with pytest.raises(CalibrationError, match="is not a refit cache"):
        RefitCache(path, *question)


@pytest.mark.parametrize("data", [b"\xff\xfe\n", b"[" * 100_000 + b"\n", b"[]\n", b"{}\n", b"9" * 5000 + b"\n"])
def test_a_file_that_is_no_cache_is_refused_and_stays(data: bytes, question, tmp_path) -> None:
    path = tmp_path / "refits.jsonl"
    path.write_bytes(data)
    with pytest.raises(CalibrationError, match="is not a refit cache"):
        RefitCache(path, *question)
    assert path.read_bytes() == data


def test_a_folder_in_its_place_is_one_sentence(question, tmp_path) -> None:
    with pytest.raises(CalibrationError, match="cannot be opened"):
        RefitCache(tmp_path, *question)


@pytest.mark.parametrize(
    "old", [{"rng": np.random.default_rng(0)}, {"journal": "refits.jsonl"}], ids=["rng", "journal"]
)
def test_former_arguments_work_with_a_warning(old: dict, question) -> None:
    with pytest.warns(DeprecationWarning, match="is now"), pytest.raises(CalibrationError, match="held-out recordings"):
        diagnose(question[0], [], [], **old)


def test_where_is_the_former_name_of_the_error_breakdown(question) -> None:
    assert where is error_breakdown and isinstance(where(question[0], question[1]), Where)
