"""The diagnosis benchmark's own book-keeping: labels, sealing, resuming and figures; no diagnosis is run."""

from __future__ import annotations

import hashlib
import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks import diagnosis, diagnosis_cases, diagnosis_figures
from benchmarks.diagnosis_cases import OUTSIDE, SEEDS, SETS, SINGLES, Label, labels
from benchmarks.diagnosis_figures import beside, clopper_pearson, confusion, figures, report
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.effect_sizes import FIRMWARE, SIZES, SUPPLY
from embodiedreamer_gym.standin.labels import FAMILIES


def row(kind="single", effects=("payload",), verdict="missing", said=None, chi2=9.0, after=0.2, index=0, **more):
    """A finished case: 1 mrad calibrated, `after` mrad with what was said."""
    said = list(effects if said is None and verdict == "missing" else said or ())
    error = {"calibrated": 1e-3, "with_effect": after * 1e-3 if said else None, "noise": 1e-4, "unit": "rad"}
    found = {"verdict": verdict, "effects": said, "error": error, "joints": {e: ["tip"] for e in said},
             "parameters": {}, "chi2": {"calibrated": [chi2, chi2]}}  # fmt: skip
    label = {"kind": kind, "effects": list(effects), "joints": {e: ["tip"] for e in effects}, "values": {}}
    return {"index": index, "seconds": 10.0, "label": label, "found": found} | more


def by_key(rows, name="main"):
    return {figure.key: figure for figure in figures(rows, name)}


@pytest.mark.parametrize("name", SETS)
def test_labels_are_the_same_every_time_and_differ_between_seeds(name):
    assert labels(name, "test") == labels(name, "test")
    assert labels(name, "test") != labels(name, "development")
    counts = SETS[name].counts
    for kind, count in counts.items():
        assert sum(label.kind == kind for label in labels(name, "test")) == count
    assert [label.index for label in labels(name, "test")] == list(range(sum(counts.values())))


def test_no_case_shares_its_generator_with_another():
    assert len(set(SEEDS.values())) == len(SEEDS)
    assert len({design.number for design in SETS.values()}) == len(SETS)
    draws = {diagnosis_cases.case_rng(n, s, k).random() for n in SETS for s in SEEDS for k in range(20)}
    assert len(draws) == 20 * len(SETS) * len(SEEDS)


def test_main_asks_for_every_effect_and_for_pairs_of_two_families():
    assert set(SIZES) == {*SINGLES, *FIRMWARE, *SUPPLY, "torque_constant"} <= set(CATALOGUE)
    asked = labels("main", "test")
    assert {e for label in asked if label.kind == "single" for e in label.effects} == set(SINGLES)
    assert {e for label in asked if label.kind == "outside" for e in label.effects} == set(OUTSIDE)
    family = {effect: name for name, effects in FAMILIES.items() for effect in effects}
    assert set(family) == set(SIZES)
    for label in asked:
        if label.kind == "pair":
            first, second = label.effects
            assert family[first] != family[second]
            assert second not in CATALOGUE[first].confused_with and first not in CATALOGUE[second].confused_with
        if label.kind in ("pair", "outside"):
            assert 1.0 <= label.strength <= 2.5
    assert {label.kind for label in asked[:8]} == set(SETS["main"].counts)
    assert {label.arm for label in labels("other_arm", "test") if label.kind == "null"} == {"arm6b", "arm7"}
    assert all(set(label.effects) < set(label.question) for label in labels("ties", "test"))


@pytest.mark.parametrize(
    ("said", "strict", "lenient"), [("ab", True, True), ("a", False, True), ("b", False, False), ("abc", False, False)]
)
def test_a_joint_that_shows_nothing_of_an_effect_may_be_left_out(said, strict, lenient):
    one = row(effects=("encoder_offset",))
    one["label"] |= {"joints": {"encoder_offset": ["a", "b"]}, "shown": {"encoder_offset": {"a": 9.0, "b": 0.1}}}
    one["found"]["joints"] = {"encoder_offset": list(said)}
    found = by_key([one, row()])
    assert found["joints"].hits == strict + 1 and found["joints"].of == 2
    assert found["joints_shown"].hits == lenient and found["joints_shown"].of == 1


def test_labels_are_sealed_before_the_first_diagnosis(tmp_path, monkeypatch, capsys):
    out = tmp_path / "run" / "main.jsonl"
    sealed = out.with_suffix(".labels.json")

    def work(name, seeds, label, oracle):
        kept = json.loads(sealed.read_text())["labels"]
        assert kept[label.index]["effects"] == list(label.effects)
        return row(label.kind, label.effects, "unknown", index=label.index)

    monkeypatch.setattr(diagnosis, "run_case", work)
    diagnosis.main(["--cases", "5", "--jobs", "1", "--out", str(out)])
    digest = hashlib.sha256(sealed.read_bytes()).hexdigest()
    assert len(json.loads(sealed.read_text())["labels"]) == 240
    assert {json.loads(line)["labels_sha256"] for line in out.read_text().splitlines()} == {digest}
    printed = capsys.readouterr().out
    assert printed.index(digest) < printed.index("diagnose   1/5 case")
    with pytest.raises(SystemExit):  # other labels beside the same rows
        diagnosis.main(["--cases", "5", "--seeds", "development", "--out", str(out)])


def test_shards_and_resumed_rows_of_earlier_releases_give_the_same_result(tmp_path, monkeypatch, capsys):
    """Rows without "run", in the order of earlier releases: the same command goes on with them."""
    ran = []

    def work(name, seeds, label, oracle):
        ran.append(label.index)
        return row(label.kind, label.effects, "unknown", index=label.index, seconds=0.1 * len(ran))

    monkeypatch.setattr(diagnosis, "run_case", work)
    common = ["--cases", "9", "--jobs", "1"]
    whole, older, parts = tmp_path / "whole.jsonl", tmp_path / "older.jsonl", [tmp_path / f"{k}.jsonl" for k in (1, 2)]
    diagnosis.main([*common, "--out", str(whole), "--results", str(tmp_path / "whole")])
    rows = [json.loads(line) for line in whole.read_text().splitlines()]
    for one in rows:
        del one["run"]
    older.write_text("".join(json.dumps(one) + "\n" for one in (rows[2], rows[0])) + json.dumps(rows[1])[:30])
    ran.clear()
    diagnosis.main([*common, "--out", str(older), "--results", str(tmp_path / "older")])
    assert ran == [1, *range(3, 9)] and list(rows[0])[:5] == ["set", "seeds", "labels_sha256", "index", "seconds"]
    diagnosis.main([*common, "--out", str(parts[0]), "--shard", "1/2"])
    also = ["--rows", str(parts[0]), "--results", str(tmp_path / "parts")]
    diagnosis.main([*common, "--out", str(parts[1]), "--shard", "2/2", *also])
    results = {(tmp_path / name / "result.json").read_bytes() for name in ("whole", "older", "parts")}
    assert len(results) == 1 and "seconds" not in results.pop().decode()
    run = json.loads((tmp_path / "parts" / "run.json").read_text())
    assert run["cases"] == 9 and run["seeds"] == "test" and run["seconds"] > 0
    capsys.readouterr()
    for wrong, said in (
        (["--shard", "3/2"], "3/2 is not a shard; give I/N such as 1/4"),
        (["--rows", str(whole), "--out", str(parts[0])], "whole.jsonl contains the case {'index': "),
        (
            ["--seeds", "development", "--rows", str(whole), "--out", str(tmp_path / "new.jsonl")],
            "has other settings: seeds is",
        ),
    ):
        with pytest.raises(SystemExit) as stop:
            diagnosis.main([*common, *wrong])
        error = capsys.readouterr().err
        assert stop.value.code == 2 and said in error and error.splitlines()[-1].count("error: ") == 1


def test_a_case_that_raises_is_kept_as_a_failure(monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("of no use")

    monkeypatch.setattr(diagnosis_cases, "draw", broken)
    found = diagnosis_cases.run_case("main", "test", labels("main", "test")[0])
    assert found["failed"] == "ZeroDivisionError: of no use"
    assert json.dumps(found)


def test_shares_of_hand_made_rows():
    rows = [
        row(),
        row(said=["payload", "base_tilt"]),
        row(verdict="ambiguous", said=["base_tilt", "payload"]),
        row(verdict="nothing_missing"),
        row(verdict="unknown", chi2=2.0),
        row(said=["base_tilt"], chi2=2.0),
        row(failed="ValueError: no"),
        row("null", (), "nothing_missing"),
        row("null", (), "missing", ["payload"]),
        row("null", (), "unknown"),
        row("pair", ("payload", "backlash"), said=["backlash", "payload"]),
        row("pair", ("payload", "backlash"), said=["payload"]),
        row("outside", verdict="unknown"),
        row("outside", said=["base_tilt"]),
        row("outside", verdict="nothing_missing", chi2=1.0),
    ]
    found = by_key(rows)
    shares = {"name": (1, 5), "name_or_tie": (2, 5), "joints": (1, 1), "misnamed": (1, 2), "accused": (1, 3),
              "detected": (5, 7), "unknown": (1, 2), "known_unknown": (1, 5), "both": (1, 2)}  # fmt: skip
    for key, (hits, of) in shares.items():
        assert (found[key].hits, found[key].of) == (hits, of), key
        assert (found[key].low, found[key].high) == clopper_pearson(hits, of)
    assert found["joints"].met and not found["name"].met
    assert by_key(rows, "teleoperation")["right_or_silent"].hits == 4
    assert (by_key(rows, "teleoperation")["name"].met, by_key(rows, "other_arm")["name"].met) == (False, None)
    text = report(rows, "main", brute=[row(named="payload"), row("null", (), named="payload")])
    assert "failed: case 0, ValueError: no" in text
    assert "always naming Coulomb friction: correct in 0 of 7 singles, false alarms in 3 of 3" in text
    assert "naming the best: correct in 1 of 1 singles" in text


def test_errors_falls_and_costs_of_hand_made_rows():
    rows = [row(after=a, oracle=1e-4) for a in (0.1, 0.19, 0.28)] + [row(verdict="unknown", oracle=2e-3)]
    found = by_key(rows)
    assert found["fall"].value == pytest.approx((0.81 + 0.72) / 2)
    above = [1 - np.sqrt((a**2 - 0.01) / 0.99) for a in (0.19, 0.28)]
    assert found["fall_above_noise"].value == pytest.approx(np.mean(above))
    assert found["gap"].value == pytest.approx(0.9) and found["gap"].of == 3
    assert (found["fall"].low, found["fall"].high) == pytest.approx((0.0, 0.9))
    rows = [row(seconds=s) for s in (10.0, 12.0, 100.0)]
    assert by_key(rows)["median_seconds"].met and not by_key(rows)["worst_seconds"].met


def test_intervals_are_held_against_the_truth():
    one = row(effects=("torque_ripple",))
    one["label"]["values"] = {"torque_ripple": {"amplitude": {"a": 1.0, "b": 2.0}, "phase": {"a": 1.0}}}
    said = {"a": ("amplitude", 0.9, 1.1), "b": ("amplitude", 2.1, 2.2), "a.phase": ("phase", 4.0, 5.0),
            "c": ("amplitude", 0.0, 1.0), "b.phase": ("phase", None, None)}  # fmt: skip
    rows = {key: {"parameter": p, "low": low, "high": high} for key, (p, low, high) in said.items()}
    one["found"]["parameters"] = {"torque_ripple": rows}
    assert diagnosis_figures.held(one) == [True, False]
    assert (by_key([one])["held"].hits, by_key([one])["held"].of) == (1, 2)


def test_ties_are_resolved_by_the_second_answer():
    again = row("tie")["found"]
    rows = [
        row("tie"),
        row("tie", verdict="ambiguous", said=["payload", "base_tilt"], next={"found": again}),
        row("tie", verdict="nothing_missing", next={"found": row("tie", verdict="unknown")["found"]}),
        row("tie", said=["base_tilt"], next=None),
    ]
    resolved = by_key(rows, "ties")["resolved"]
    assert (resolved.hits, resolved.of) == (1, 3)
    assert "correctly named at first, so no further motion was needed: 1 of 4" in report(rows, "ties")


def test_without_chi2_the_error_in_noises_says_what_is_visible():
    old = row()
    del old["found"]["chi2"]
    assert diagnosis_figures.visible(old)
    old["found"]["error"]["noise"] = 9e-4
    assert not diagnosis_figures.visible(old)


def test_another_arm_may_be_five_points_worse():
    main = [row() for _ in range(20)] + [row("null", (), "nothing_missing")] * 20
    other = [row() for _ in range(19)] + [row(verdict="unknown")] + [row("null", (), "unknown")] * 18
    lines = beside(figures(other + [row("null", ())] * 2, "other_arm"), figures(main, "main"))
    assert [line.endswith("met") for line in lines] == [True, False, True]  # name, accused, detected


def test_the_confusion_matrix_counts_what_was_said_of_what():
    rows = [row(), row(), row(said=["base_tilt"]), row(verdict="ambiguous", said=["payload", "base_tilt"]),
            row("null", (), "nothing_missing"), row("outside", verdict="unknown")]  # fmt: skip
    *_, head, payload, outside, faultless = confusion(rows).splitlines()
    assert head.split() == ["1", "2", "noth", "tie", "unkn"]
    assert payload.split() == ["payload", "1", "2", ".", "1", "."]
    assert outside.split() == ["payload,", "outside", ".", ".", ".", ".", "1"]
    assert faultless.split() == ["faultless", ".", ".", "1", ".", "."]


@pytest.mark.parametrize("name", ["main", "positions", "no_command", "poor_urdf", "teleoperation"])
def test_the_diagnoser_gets_files_without_the_truth(name, tmp_path, monkeypatch):
    monkeypatch.setattr(diagnosis_cases, "SETS", {n: short(d) for n, d in SETS.items()})
    label = Label(0, "single", ("torque_bias",), 1.0, "pendulum1")
    case = diagnosis_cases.draw(name, "test", label)
    case.write(tmp_path)
    logs = [*load_recordings(str(tmp_path / "train")), *load_recordings(str(tmp_path / "test"))]
    assert len(logs) == 4
    assert all((log.command is None) == (name in ("no_command", "poor_urdf")) for log in logs)
    assert all((log.effort is None) == (name == "positions") and log.velocity is None for log in logs)
    assert logs[0].hz == pytest.approx(30 if name == "teleoperation" else 100, rel=1e-6)
    assert not any("torque_bias" in p.read_text() for p in tmp_path.rglob("*") if p.is_file())


def test_a_tie_is_asked_again_with_the_proposed_motion_recorded_twice(tmp_path, monkeypatch):
    label = Label(0, "tie", ("torque_bias",), 1.0, "pendulum1", ("torque_bias", "joint_spring"))
    monkeypatch.setattr(diagnosis_cases, "SETS", {"ties": short(SETS["ties"])})
    case = diagnosis_cases.draw("ties", "test", label)
    model = RobotModel.load(case.write(tmp_path))
    asked = []

    def propose(model, pair, recordings, centre):
        asked.append((pair, len(recordings), centre.shape))
        time = np.linspace(0.0, 0.5, 26)
        return SimpleNamespace(
            time=time, command=centre + 0.1 * time[:, None], kind="multisine", separation=3.0, log_likelihood=90.0
        )

    def look(model, folder, known):
        logs = [load_recordings(f"{folder}/{part}") for part in ("train", "test")]
        assert [len(part) for part in logs] == [3, 3]
        assert "multisine" in logs[0].by_kind() and "multisine" in logs[1].by_kind()
        return SimpleNamespace(as_dict=lambda: {"verdict": "missing"})

    monkeypatch.setattr(diagnosis_cases, "propose_motion", propose)

    def answer(model, pair, train, test):
        assert [len(train), len(test)] == [3, 3]
        return SimpleNamespace(as_dict=lambda: {"best": pair[0]})

    monkeypatch.setattr(diagnosis_cases, "_diagnose", look)
    monkeypatch.setattr(diagnosis_cases, "decide", answer)
    for verdict, pair, unseen in (("ambiguous", ("payload", "base_tilt"), ()), ("unknown", label.question, label.question),
                                  ("missing", None, ())):  # fmt: skip
        found: Any = SimpleNamespace(verdict=verdict, unobservable=unseen, question=lambda asked, pair=pair: pair)
        again = diagnosis_cases.ask_again(case, model, str(tmp_path), found, label)
        assert (again is None) == (verdict == "missing")
        assert again is None or (again["decision"]["best"] == pair[0] and again["log_likelihood"] == 90.0)
    assert asked == [(("payload", "base_tilt"), 2, (1,)), (("torque_bias", "joint_spring"), 0, (1,))]


def short(design):
    return diagnosis_cases.Design(design.number, design.counts, recording={**design.recording, "seconds": 0.5})


def test_an_effect_outside_the_catalogue_is_unknown_or_of_its_family():
    family = row("outside", ("command_delay",), "ambiguous", ("command_lowpass", "lookahead"))
    family["found"]["family"] = "late_command"
    member = row("outside", ("command_delay",), "missing", ("lookahead",))
    other = row("outside", ("command_delay",), "missing", ("payload",))
    silent = row("outside", ("command_delay",), "unknown")
    contained = row("outside", ("coulomb_friction",), "missing", ("stribeck_friction",))
    shown = by_key([family, member, other, silent, contained])
    assert (shown["unknown"].hits, shown["unknown"].of) == (2, 4)
    assert (shown["relative"].hits, shown["relative"].of) == (3, 4)


def test_probabilities_that_are_claimed_are_counted():
    right, wrong = row(), row(said=("torque_bias",))
    right["found"]["members"], wrong["found"]["members"] = {"payload": 0.99}, {"torque_bias": 0.97}
    unsure = row(said=("torque_bias",))
    unsure["found"]["members"] = {"torque_bias": 0.6}
    shown = by_key([right, wrong, unsure])
    assert (shown["sure"].hits, shown["sure"].of) == (1, 2)
    assert (shown["family"].hits, shown["family"].of) == (3, 3)  # a bias is of the payload's family
