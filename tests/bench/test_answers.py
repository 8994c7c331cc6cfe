"""Answers: what is allowed is read back as it was written, all else is one sentence with file and line."""

import json

import numpy as np
import pytest

from embodiedreamer_gym.bench.answers import (
    Answer,
    NamedEffect,
    answer_line,
    parse_answer,
    read_answers,
    read_prediction,
)
from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.errors import EmbodieDreamerError

PAYLOAD = NamedEffect("payload", 0.9, ("tip",), {"mass": {"tip": {"value": 0.2, "low": 0.1, "high": 0.3}}})
GOOD = Answer("mine", "0001", "missing", (PAYLOAD,), {"slow-1": "files/slow-1.csv"}, 1.5)
TIME = np.linspace(0, 1, 11)


@pytest.mark.parametrize(
    "answer", [GOOD, Answer("mine", "0002"), Answer("mine", "0003", "unknown", failed="no reason")]
)
def test_an_answer_is_read_as_it_was_written(answer):
    assert parse_answer(answer_line(answer), "here") == answer


def test_the_last_answer_to_a_case_counts_and_a_torn_line_does_not(tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text(answer_line(Answer("mine", "0001")) + answer_line(GOOD) + answer_line(GOOD)[:30])
    assert read_answers(path) == [GOOD]


def change(**fields):
    return json.loads(answer_line(GOOD)) | fields


WRONG = {
    "[]": "must be a JSON object", "{": "not a JSON object", json.dumps(change(verdict="yes")): "verdict 'yes' must be null or one of",
    json.dumps(change(colour=1)): "the field 'colour'", json.dumps(change(case=1)): "case must be a text",
    json.dumps(change(effects=[])): "needs effects", json.dumps(change(verdict="nothing_missing")): "must not name effects",
    json.dumps(change(effects=[{"name": "a"}, {"name": "a"}])): "twice",
    json.dumps(change(effects=[{"name": "a", "probability": 2}])): "number from 0 to 1",
    json.dumps(change(effects=[{"name": "a", "joints": "tip"}])): "must be a JSON list",
    json.dumps(change(effects=[{"name": "a", "parameters": {"p": {"j": {"value": 1, "low": 0}}}}])): "both low and high",
    json.dumps(change(effects=[{"name": "a", "parameters": {"p": {"j": {"value": 1, "low": 2, "high": 1}}}}])): "above its high",
    json.dumps(change(predictions={"slow-1": "../truth.csv"})): "below the answers' folder",
    json.dumps(change(predictions={"slow-1": "/etc/passwd"})): "below the answers' folder",
    json.dumps(change(seconds=float("nan"))): "number from 0", json.dumps(change(entry="a\nb")): "printable", "[" * 100_000: "not a JSON object",
}  # fmt: skip


@pytest.mark.parametrize("line", WRONG)
def test_a_wrong_answer_is_one_sentence(line, tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text(answer_line(GOOD) + line + "\n")
    with pytest.raises(EmbodieDreamerError, match=f"line 2.*{WRONG[line]}"):
        read_answers(path)


def test_the_command_says_what_is_wrong(made, tmp_path, capsys):
    path = tmp_path / "a.jsonl"
    for text, said in {
        "{}\n": "entry must be",
        answer_line(Answer("mine", "9999")): "'9999' is not one",
        "": "no answer",
    }.items():
        path.write_text(text)
        assert main(["bench", "score", "--truth", str(made.truth), "--answers", str(path), "--quiet"]) == 2
        assert said in capsys.readouterr().err
    assert main(["bench", "score", "--truth", str(tmp_path), "--answers", str(path), "--quiet"]) == 2
    assert main(["bench", "run", "mine", "--cases", str(made.cases), "--out", str(path), "--quiet"]) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column time"), ("time,b.position\n0,1\n1,1\n", "no column a.position"), ("time,a.position\n", "no row"),
        ("time,a.position\n0,1\n1,x\n", "could not convert"), ("time,a.position\n0,1\n1,nan\n", "not finite"),
        ("time,a.position\n0,1\n1,1e308\n", "above 1e.100"),
        ("time,a.position\n0,1\n0,1\n", "not increase"), ("time,a.position\n0,1\n0.5,1\n", "it covers 0 to 0.5"),
        ("time,a.position\n0,1\n1\n", "1 values"),
    ],
)  # fmt: skip
def test_a_wrong_prediction_is_one_sentence(tmp_path, text, said):
    path = tmp_path / "p.csv"
    path.write_text(text)
    with pytest.raises(EmbodieDreamerError, match=said):
        read_prediction(path, ("a",), "position", TIME)
    with pytest.raises(EmbodieDreamerError):
        read_prediction(tmp_path / "none.csv", ("a",), "position", TIME)


def test_a_prediction_may_have_other_times_and_columns(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("b.position,time,a.position\n5,0,0\n5,1,2\n")
    np.testing.assert_allclose(read_prediction(path, ("a",), "position", TIME)[:, 0], 2 * TIME)
