"""Scores: of answers that are right throughout, of one that always says the same, and of none."""

import json
import shutil

import pytest

from embodiedreamer_gym.bench.answers import Answer, NamedEffect, answer_line, write_prediction
from embodiedreamer_gym.bench.cases import signal_of
from embodiedreamer_gym.bench.intervals import clopper_pearson, median_interval
from embodiedreamer_gym.bench.score import read_truth, score
from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.standin.labels import places


def perfect(made, folder):
    """The truth as answers, with the withheld recordings themselves as predictions."""
    answers = []
    for case, hidden in made.hidden.items():
        files = {}
        for name, log in hidden.withheld.items():
            files[name] = f"p/{case}/{name}.csv"
            signal = signal_of(log)
            write_prediction(folder / files[name], log.time, log.joints, signal, getattr(log, signal))
        effects = tuple(
            NamedEffect(name, 1.0, tuple(places(hidden.effects)[name]), {
                parameter: {at: {"value": v, "low": v - 1e-3, "high": v + 1e-3} for at, v in row.items()}
                for parameter, row in rows.items()})
            for name, rows in hidden.effects.items()
        )  # fmt: skip
        answers.append(Answer("perfect", case, "missing" if effects else "nothing_missing", effects, files))
    return answers


def table(made, path, answers):
    path.write_text("".join(map(answer_line, answers)))
    scores = score(made.truth, [path])
    assert str(scores) and scores.as_dict()["truth_sha256"] == made.digest
    return {f.key: f for f in scores.figures if f.observation == "all"}, scores


def test_right_answers_score_fully(made, tmp_path):
    found, scores = table(made, tmp_path / "a.jsonl", perfect(made, tmp_path))
    assert found["accused"].value == 0 and found["accused"].of == 2
    shares = ("name", "name_or_tie", "family", "joints", "subset_joints", "held")
    assert all(found[key].value == 1 for key in shares if key in found) and {"name", "joints", "subset_joints"} <= set(
        found
    )
    assert (found["name"].low, found["name"].high) == clopper_pearson(2, 2)
    assert found["to_noise"].value < 1e-3 and found["to_nominal"].value < 1e-3
    assert {f.observation for f in scores.figures} == {"all", "effort", "no_command"} and not scores.notes


def test_always_the_same_accuses_faultless_robots(made, tmp_path):
    said = (NamedEffect("coulomb_friction", joints=("joint1",)),)
    found, _ = table(made, tmp_path / "a.jsonl", [Answer("same", case, "missing", said) for case in made.hidden])
    true = [hidden for hidden in made.hidden.values() if hidden.effects]
    right = sum(set(hidden.effects) == {"coulomb_friction"} for hidden in true)
    assert found["accused"].value == 1 and found["name"].value == right / len(true)
    assert "to_nominal" not in found


def test_a_tie_with_the_truth_is_no_right_name(made, tmp_path):
    answers = [
        Answer("tie", case, "ambiguous", (*map(NamedEffect, hidden.effects), NamedEffect("something_else")))
        for case, hidden in made.hidden.items()
    ]
    found, _ = table(made, tmp_path / "a.jsonl", answers)
    assert found["name"].value == 0 and found["name_or_tie"].value == 1


def test_cases_without_an_answer_count_as_wrong(made, tmp_path):
    case = next(case for case, hidden in made.hidden.items() if hidden.effects)
    found, scores = table(made, tmp_path / "a.jsonl", [Answer("few", case, "unknown")])
    assert found["accused"].value == 1 and found["name"].of == 2 and "3 of 4 cases without an answer" in scores.notes[0]


def test_what_names_nothing_has_errors_and_no_shares(made, tmp_path):
    answers = [Answer("blind", a.case, None, (), a.predictions) for a in perfect(made, tmp_path)]
    found, _ = table(made, tmp_path / "a.jsonl", answers)
    assert set(found) == {"to_nominal", "to_noise"}


def test_intervals():
    assert clopper_pearson(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert clopper_pearson(5, 10) == pytest.approx((0.1871, 0.8129), abs=1e-4)
    assert median_interval([3, 1, 2]) == (1, 3)
    assert median_interval(range(1, 11)) == (2, 9)


def test_shards_give_the_same_scores_to_the_byte(made, tmp_path, capsys):
    """Of one, two and four shards; answers to other cases are refused."""
    written = []
    for count in (1, 2, 4):
        files = [tmp_path / f"{count}-{number}.jsonl" for number in range(1, count + 1)]
        for number, file in enumerate(files, 1):
            words = ["--shard", f"{number}/{count}", "--out", str(file), "--quiet"]
            assert main(["bench", "run", "ladder", "--cases", str(made.cases), *words]) == 0
        folder = tmp_path / f"results-{count}"
        answers = ["--answers", *map(str, reversed(files)), "--results", str(folder), "--quiet"]
        assert main(["bench", "score", "--truth", str(made.truth), *answers]) == 0
        written.append((folder / "result.json").read_bytes())
        run = json.loads((folder / "run.json").read_text())
        assert run["cases"] == 4 and run["seeds"] == [2] and run["seconds"] > 0 and run["machine"]
    assert len(set(written)) == 1 and len(json.loads(written[0])["figures"]) > 10
    capsys.readouterr()
    text = files[0].read_text().replace(made.digest, "0" * 64)
    files[0].write_text(text)
    assert main(["bench", "score", "--truth", str(made.truth), *answers]) == 2
    assert f"belongs to another set of cases than {made.truth}" in capsys.readouterr().err
    assert main(["bench", "run", "ladder", "--cases", str(made.cases), "--out", str(files[0]), "--quiet"]) == 2
    assert "truth_sha256 is '00000000" in capsys.readouterr().err and files[0].read_text() == text


@pytest.mark.parametrize("text", ["0/2", "3/2", "two"])
def test_a_bad_shard_is_one_sentence(text, made, tmp_path, capsys):
    words = ["--cases", str(made.cases), "--out", str(tmp_path / "a.jsonl"), "--shard", text]
    assert main(["bench", "run", "ladder", *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: argument --shard: ") and "is not a shard; give I/N such as 1/4" in error
    assert error.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(("field", "value"), [("sensor_sd", [[1.0], 1.0]), ("effects", [1]), ("nominal_rms", "x")])
def test_a_damaged_truth_is_one_sentence(field, value, made, tmp_path):
    shutil.copytree(made.truth, tmp_path / "truth")
    data = json.loads((tmp_path / "truth" / "truth.json").read_text())
    next(iter(data["cases"].values()))[field] = value
    (tmp_path / "truth" / "truth.json").write_text(json.dumps(data))
    with pytest.raises(EmbodieDreamerError, match=r"truth\.json is damaged"):
        read_truth(tmp_path / "truth")
