"""Entries: each answers a small case, the same again, and what it does not know is left open."""

import json
import shutil

import numpy as np
import pytest

from embodiedreamer_gym.bench.answers import Answer, answer_line, read_answers
from embodiedreamer_gym.bench.cases import rms_error
from embodiedreamer_gym.bench.entries import ENTRIES, load_entry, regression
from embodiedreamer_gym.bench.run import answer_case, run_entries
from embodiedreamer_gym.bench.task import load_task
from embodiedreamer_gym.cli import bench_run
from embodiedreamer_gym.cli.command import main

NAMING = ("nothing_missing", "missing", "ambiguous", "unknown")


def error(made, case, predictions):
    return rms_error([(predictions[name], log) for name, log in made.hidden[case].withheld.items()])


def nominal(made, case):
    return made.hidden[case].nominal


@pytest.mark.parametrize("name", ["ladder", "sparse"])
@pytest.mark.parametrize("case", ["0003", "0002"])
def test_regressions_answer_with_and_without_a_command(made, name, case):
    found = load_entry(name)(load_task(made.folder(case)))
    assert found.verdict in ("nothing_missing", "missing") and bool(found.effects) == (found.verdict == "missing")
    assert 0 < error(made, case, found.predictions) < 1.5 * nominal(made, case)


def test_least_squares_finds_the_terms_that_made_a_torque():
    rng = np.random.default_rng(0)
    q, v, a = rng.standard_normal((3, 400, 2))
    torque = 3 * q + rng.standard_normal(q.shape)
    columns = {name: term(q, v, a, torque) for name, term in regression.TERMS.items()}
    rest = 0.8 * np.tanh(v / regression.SLOW) + 0.3 * v
    found = regression.solve(rest, columns, np.ones((len(columns), 2), bool))
    true = np.zeros((len(columns), 2))
    true[list(columns).index("sign v")], true[list(columns).index("v")] = 0.8, 0.3
    np.testing.assert_allclose(found, true, atol=0.02)
    against = regression.solve(-rest, columns, np.ones((len(columns), 2), bool))
    assert not against[list(columns).index("sign v")].any()  # friction gives no energy


def test_trees_lower_the_error_and_name_nothing(made):
    pytest.importorskip("sklearn")
    found = load_entry("boosted")(load_task(made.folder("0003")))
    assert found.verdict is None and not found.effects and set(found.predictions) == set(made.hidden["0003"].withheld)


@pytest.mark.slow
def test_the_toolbox_of_mujoco_names_a_structure_or_none(made):
    pytest.importorskip("absl")
    pytest.importorskip("colorama")
    found = load_entry("mujoco-sysid")(load_task(made.folder("0003")))
    assert found.verdict in NAMING and error(made, "0003", found.predictions) < nominal(made, "0003")


def test_a_run_is_continued_where_it_was_interrupted(made, tmp_path):
    out = tmp_path / "a.jsonl"
    kept = [Answer("ladder", case, "unknown") for case in ("0001", "0002", "0003")]
    out.write_text("".join(map(answer_line, kept)) + '{"entry": "ladd')
    answers = run_entries(["ladder"], made.cases, out)
    assert answers[:3] == kept and read_answers(out) == answers and len(answers) == 4
    assert answers[3].case == "0004" and (tmp_path / answers[3].predictions["teleoperation-5"]).is_file()


def test_what_an_entry_cannot_do_is_a_failed_answer(made, tmp_path, monkeypatch):
    def diverge(task):
        raise ArithmeticError("too large")

    monkeypatch.setattr("embodiedreamer_gym.bench.run.load_entry", lambda name: diverge)
    answer = answer_case("ladder", made.folder("0001"), tmp_path / "a.jsonl")
    assert answer.failed == "ArithmeticError: too large" and answer.verdict is None


def test_a_damaged_case_is_one_sentence(made, tmp_path, capsys):
    folder = tmp_path / "cases" / "0001"
    folder.mkdir(parents=True)
    (tmp_path / "bench.json").write_text("{}")
    for text in ("[]", "{", json.dumps({"case": 1, "predict": {"x": 1}})):
        (folder / "case.json").write_text(text)
        assert main(["bench", "run", "ladder", "--cases", str(tmp_path), "--out", str(tmp_path / "a"), "--quiet"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_the_help_names_every_entry():
    assert tuple(ENTRIES) == bench_run.ENTRIES


def test_a_start_that_is_not_finite_names_its_file(made, tmp_path, capsys):
    """Of a motion that is to be predicted."""
    shutil.copytree(made.cases, tmp_path / "cases")
    file = tmp_path / "cases" / made.folder("0001").relative_to(made.cases) / "case.json"
    data = json.loads(file.read_text())
    start = next(iter(data["predict"].values()))
    start[next(iter(start))] = float("nan")
    file.write_text(json.dumps(data))
    assert (
        main(["bench", "run", "ladder", "--cases", str(tmp_path / "cases"), "--out", str(tmp_path / "a"), "--quiet"])
        == 2
    )
    assert f"{file} is not a case of the benchmark: the start of" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coulomb", "diagnose"])
def test_fits_of_this_package_lower_the_error(made, name):
    found = load_entry(name)(load_task(made.folder("0003")))
    assert found.verdict in NAMING and error(made, "0003", found.predictions) < nominal(made, "0003")
    if name == "coulomb":
        assert [effect.name for effect in found.effects] == ["coulomb_friction"]
