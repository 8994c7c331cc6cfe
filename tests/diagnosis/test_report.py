from __future__ import annotations

import base64
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from embodiedreamer_gym.diagnosis import Diagnosis, compare, error_breakdown
from embodiedreamer_gym.diagnosis.diagnosis import Ranked
from embodiedreamer_gym.diagnosis.notes import notes_on
from embodiedreamer_gym.diagnosis.report import write_report
from embodiedreamer_gym.diagnosis.report.sentences import false_alarm_sentence, verdict_sentence
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.phys_aligner import calibrate
from tests.two_joint_arm import load_arm, record, write_arm

VOID = {"meta", "img", "br", "link", "hr"}
NASTY = '<script>alert("$x$")</script> & 関節'


@dataclass
class Page(HTMLParser):
    """What a page holds; fails on tags that do not match."""

    text: str = ""
    images: list[dict] = field(default_factory=list)
    tags: list[str] = field(default_factory=list)
    headings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self._open: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for _, value in attrs:
            assert not (value or "").startswith(("http:", "https:", "//")), value
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if self._open and self._open[-1] == "h2":
            self.headings.append(data)
        if not self._open or self._open[-1] != "style":
            self.text += data

    def done(self) -> Page:
        self.close()
        assert self._open == []
        return self


def opened(path: Path) -> Page:
    source = path.read_text(encoding="utf-8")
    assert "http:" not in source and "https:" not in source
    page = Page()
    page.feed(source)
    page.done()
    assert "script" not in page.tags
    for image in page.images:
        assert len(image["alt"]) > 10
        kind, _, code = image["src"].partition(",")
        assert kind == "data:image/png;base64"
        pixels = cv2.imdecode(np.frombuffer(base64.b64decode(code), np.uint8), cv2.IMREAD_COLOR)
        assert pixels.shape[1] > 1000 and pixels.std() > 5
    return page


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def delayed(arm):
    return arm.with_effect("command_delay").with_values({"command_delay.seconds": {"shoulder": 0.03}})


@pytest.fixture(scope="module")
def logs(delayed):
    return [record(delayed, f"wave_{s}", 5e-4, seed=s) for s in range(2)]


def answer(arm, delayed, verdict: str = "missing", effects: tuple[str, ...] = ("command_delay",)) -> Diagnosis:
    error = {"nominal": 0.03, "calibrated": 0.02, "with_effect": 0.0007, "noise": 0.0005, "least_squares": None}
    return Diagnosis(
        verdict=verdict, sentence="Missing: command_delay on shoulder.", effects=effects,
        joints={e: ("shoulder",) for e in effects}, parameters={},
        ranking=(Ranked("command_delay", 1.1, 3.0, 0.1, 0.5), Ranked("payload", 300.0, 0.1, 0.1, 0.1)),
        error=error, end_effector_mm={"nominal": 9.0, "calibrated": 4.0, "with_effect": 0.2, "noise": 0.1},
        unobservable=("torque_saturation",), unexplained={"elbow": 0.4},
        steps=(("nominal", 0.03), ("calibrated", 0.02), ("+ command_delay", 0.0007)), p_value=0.001,
        rollouts=100, seconds=5.0, unit="rad", chi2={}, closest=(), nominal=arm, calibrated=arm, model=delayed,
        family=None, members={e: 1.0 if verdict == "missing" else 0.5 for e in effects}, excess=0.9, explainable={},
    )  # fmt: skip


def test_a_page_of_one_comparison(arm, logs, tmp_path) -> None:
    path = write_report(tmp_path / "report", comparison=compare(arm, logs))
    page = opened(path)
    assert path == tmp_path / "report" / "index.html" and list(path.parent.iterdir()) == [path]
    assert "times the sensor noise" in page.text and "shoulder" in page.text
    assert len(page.images) == 2  # overlays and heat map


def test_a_page_of_two_models_has_a_staircase(arm, delayed, logs, tmp_path) -> None:
    page = opened(write_report(tmp_path, models=(arm, delayed), recordings=logs))
    assert "How far the error falls" in page.headings and len(page.images) == 3
    assert "The error goes from" in page.text


def test_a_page_of_where(arm, logs, tmp_path) -> None:
    found = error_breakdown(arm, logs)
    page = opened(write_report(tmp_path, breakdown=found))
    assert all(sentence in page.text for sentence in found.findings)
    assert len(page.images) == 4  # overlays, heat map, profiles, sides


def test_a_page_of_a_calibration_alone(delayed, logs, tmp_path) -> None:
    fit = calibrate(delayed, logs)
    page = opened(write_report(tmp_path, calibration=fit))
    assert "Calibrated by least-squares" in page.text and "stiffness[shoulder]" in page.text
    assert len(page.images) == 1  # intervals


def test_a_family_is_named_where_no_effect_is(arm, delayed) -> None:
    tie = replace(answer(arm, delayed, "ambiguous", ("command_delay", "command_lowpass")), family="late_command",
                  members={"command_delay": 0.71, "command_lowpass": 0.26, "payload": 0.001})  # fmt: skip
    sentence = verdict_sentence(tie.as_dict())
    assert "late command" in sentence and "0.71" in sentence and "payload" not in sentence
    inexact = verdict_sentence(replace(answer(arm, delayed), excess=1.6).as_dict())
    assert "law is not exact" in inexact and "not exact" not in verdict_sentence(answer(arm, delayed).as_dict())


def test_the_effect_of_a_pair_that_is_certain_is_named_beside_the_open_ones(arm, delayed) -> None:
    tie = replace(answer(arm, delayed, "ambiguous", ("payload", "base_tilt", "command_delay")),
                  members={"command_delay": 1.0, "payload": 0.6, "base_tilt": 0.4})  # fmt: skip
    sentence = verdict_sentence(tie.as_dict())
    assert "lacks command delay on shoulder, and also payload on shoulder or base tilt on shoulder; these" in sentence


def test_the_ceiling_stands_beside_the_rest(arm, delayed) -> None:
    shares = {"command": 0.7, "motion": 0.75, "history": 0.9, "load": 0.9}
    text = str(replace(answer(arm, delayed), explainable={"elbow": shares}))
    assert "elbow: 90 % of the calibrated error is predictable, most of it from the command" in text


def test_notes_stand_before_the_verdict(arm, delayed, logs, tmp_path) -> None:
    """The times of one log are frame numbers over a rate: whoever reads of a delay has to know."""
    assert notes_on(arm, logs) == ()
    (note,) = notes_on(arm, [logs[0].with_(nominal_time=True), logs[1]])
    assert "1 of 2 recordings" in note and "rate of 100 Hz, not measured" in note and "10 ms" in note
    found = replace(answer(arm, delayed), notes=(note,))
    assert str(found).splitlines()[:2] == [note, "Missing: command_delay on shoulder."]
    assert (
        found.as_dict()["notes"] == [note]
        and note in opened(write_report(tmp_path, diagnosis=found, recordings=logs)).text
    )


def test_a_page_compares_on_recordings_that_were_not_learned_from(arm, delayed, logs, tmp_path) -> None:
    held_out = "on recordings that no fit has used"
    found = replace(answer(arm, delayed), learned_from=(logs[0].name,))
    page = opened(write_report(tmp_path, diagnosis=found, recordings=[logs[0].with_(name="other"), logs[0]]))
    alone = opened(write_report(tmp_path, diagnosis=found, recordings=[logs[0].with_(name="other")]))
    assert page.text == alone.text and held_out in page.text
    both = compare([arm, delayed], logs, ("calibrated", "with_effect"))
    assert held_out not in opened(write_report(tmp_path, diagnosis=found, comparison=both)).text


def test_a_page_of_a_diagnosis(arm, delayed, logs, tmp_path) -> None:
    found = answer(arm, delayed)
    page = opened(write_report(tmp_path, diagnosis=found, breakdown=error_breakdown(arm, logs), recordings=logs))
    assert "The model lacks command delay on shoulder; with it the held-out error falls" in page.text
    assert {"How far the error falls", "Effects tried", "Parameters"} <= set(page.headings)
    assert "torque saturation" in page.text and "40\N{NO-BREAK SPACE}%" in page.text
    assert false_alarm_sentence().replace("`", "") in page.text and "have a probability of 0.001" in page.text
    assert "3.00 [2.80, 3.20]" in page.text  # gain of the delay, 1.96 standard errors to either side
    assert "\N{MINUS SIGN}9" in page.text and "times noise" in page.text
    assert len(page.images) == 6  # staircase, overlays, ranking, heat map, profiles, sides
    opened(write_report(tmp_path, diagnosis=found))


@pytest.mark.parametrize(
    ("verdict", "effects", "words"),
    [
        ("missing", ("command_delay", "payload"), "lacks command delay on shoulder and payload on shoulder"),
        (
            "ambiguous",
            ("command_delay", "payload"),
            "delay on shoulder or payload on shoulder; these recordings",
        ),
        ("nothing_missing", (), "These recordings show no missing effect"),
        ("unknown", (), "no known effect explains"),
    ],
)
def test_each_verdict_is_one_sentence(arm, delayed, verdict, effects, words) -> None:
    sentence = verdict_sentence(answer(arm, delayed, verdict, effects).as_dict())
    assert words in sentence and sentence.endswith(".") and "\n" not in sentence


def test_a_verdict_says_what_to_do_next(arm, delayed, tmp_path) -> None:
    tie = opened(write_report(tmp_path, diagnosis=answer(arm, delayed, "ambiguous", ("command_delay", "payload"))))
    assert "embodiedreamer excite --separate command_delay,payload" in tie.text
    unknown = replace(answer(arm, delayed, "unknown", ()), sentence="Unknown: the closest, payload, explains 20 %.")
    assert unknown.sentence in opened(write_report(tmp_path, diagnosis=unknown)).text


@pytest.mark.parametrize(
    ("unobservable", "tried", "words"),
    [
        (("torque_saturation",), True, "cannot show: torque saturation."),
        ((), True, "None of the catalogue"),
        ((), False, "Not examined"),
    ],
)
def test_it_says_what_cannot_be_seen(arm, delayed, tmp_path, unobservable, tried, words) -> None:
    found = answer(arm, delayed)
    found = replace(found, unobservable=unobservable, ranking=found.ranking if tried else ())
    page = opened(write_report(tmp_path, diagnosis=found))
    assert "What these sensors and this motion cannot show" in page.headings and words in page.text


@pytest.mark.parametrize(
    ("alarms", "robots", "most"), [(0, 10, 31), (0, 100, 4), (3, 100, 9), (10, 10, 100), (0, 1, 98)]
)
def test_false_alarms_have_an_exact_interval(alarms: int, robots: int, most: int) -> None:
    sentence = false_alarm_sentence(alarms, robots)
    assert f"For {robots} simulated robots" in sentence and f"missing effect for {alarms} " in sentence
    assert f"at most {most}\N{NO-BREAK SPACE}%" in sentence and "`make bench-diagnosis`" in sentence


def test_a_page_of_logs_without_commands_is_about_effort(arm, logs, tmp_path) -> None:
    blind = [log.with_(command=None, effort=log.effort / 2, effort_unit="N m") for log in logs]
    heavy = arm.with_(rotor_inertia=arm.rotor_inertia * 2)
    page = opened(write_report(tmp_path, models=(heavy, arm), recordings=blind))
    assert "mN m" in page.text and "mrad" not in page.text and "effort error" in page.text
    assert len(page.images) == 3


def test_names_from_files_are_escaped(tmp_path) -> None:
    arm = load_arm(tmp_path)
    arm = arm.with_(name=NASTY, joints=arm.joints)
    log = record(arm, NASTY, 5e-4)
    page = opened(
        write_report(tmp_path / "report", comparison=compare(arm, [log]), breakdown=error_breakdown(arm, [log]))
    )
    assert NASTY in page.text


def test_a_second_report_replaces_the_first(arm, logs, tmp_path) -> None:
    write_report(tmp_path, comparison=compare(arm, logs[:1]))
    page = opened(write_report(tmp_path, comparison=compare(arm, logs)))
    assert "2 recordings" in page.text


def test_what_cannot_be_written_is_one_sentence(arm, logs, tmp_path) -> None:
    with pytest.raises(EmbodieDreamerError, match="nothing to report"):
        write_report(tmp_path)
    assert write_report(tmp_path / "new" / "folder", comparison=compare(arm, logs)).is_file()
    file = write_arm(tmp_path)
    with pytest.raises(EmbodieDreamerError, match="cannot be written"):
        write_report(file, comparison=compare(arm, logs))
