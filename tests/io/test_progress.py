"""Progress is shown with names and units, and never pauses for more than ten seconds."""

from __future__ import annotations

import re
import sys
import time

import pytest

from embodiedreamer_gym.io import progress as module
from embodiedreamer_gym.io.progress import Progress, duration, progress_or_silence, silent


class Terminal:
    """A stderr that is a terminal."""

    def __init__(self) -> None:
        self.text = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None: ...


def test_a_log_has_a_line_at_once_and_then_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress()
    progress("training", 0, 100)
    assert re.fullmatch(r" +0 s  training: 0 of 100 \(0 %\)\n", capsys.readouterr().err)
    for step in range(1, 50):
        progress("training", step, 100, loss="0.5")
    progress.close()
    assert capsys.readouterr().err == ""


def test_a_log_has_a_line_also_while_a_step_takes_long(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert module.SILENCE + module.TICK < 10.0
    monkeypatch.setattr(module, "SILENCE", 0.3)
    progress = Progress()
    progress("null distribution", 0, held_out_error="1.454 mrad")
    time.sleep(1.2)
    progress.close()
    lines = capsys.readouterr().err.splitlines()
    assert 3 <= len(lines) <= 5 and all(line.endswith("null distribution, held out error 1.454 mrad") for line in lines)
    time.sleep(0.5)
    assert capsys.readouterr().err == ""  # nothing comes after close


def test_the_last_stage_is_seen_where_stages_follow_fast(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "REDRAW", (0.1, 0.3))
    progress = Progress()
    for stage in "abcdef":
        progress(stage)
    time.sleep(0.6)
    progress.close()
    assert [line.split()[-1] for line in capsys.readouterr().err.splitlines()] == ["a", "f"]


def test_a_terminal_has_one_line_that_is_cleared(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    progress = Progress()
    progress("training", 0, 4, loss=2)
    time.sleep(0.15)
    progress("training", 1, 4, loss=1)
    shown = terminal.text
    progress.note("a note")
    assert "\n" not in shown and re.search(r"1 of 4 \(25 %\), loss 1, \d s left", shown)
    assert terminal.text.endswith("\ra note\n") or terminal.text.endswith(" \ra note\n")


def test_time_left_counts_from_where_the_stage_began(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    progress = Progress(quiet=True)
    progress._quiet, progress._show = False, lambda: None  # type: ignore[method-assign]
    progress("episodes", 10, 13)
    now = 60.0
    progress("episodes", 11, 13, failed=1)
    progress.close()
    assert progress._text == "episodes: 11 of 13 (84 %), failed 1, 2 min left"


def test_quiet_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(quiet=True)
    progress("training", 1, 2)
    assert progress._thread is None and capsys.readouterr().err == ""


def test_a_callback_of_the_former_form_is_called_with_a_number_and_a_warning() -> None:
    calls: list[tuple[object, ...]] = []
    with pytest.warns(DeprecationWarning, match="quantities"):
        report = progress_or_silence(lambda stage, step, value: calls.append((stage, step, value)))
    report("annealing", 3, 20, residual="1.2")
    assert calls == [("annealing", 3, 20.0)]


def test_the_present_form_is_passed_through_and_none_is_silent(recwarn: pytest.WarningsRecorder) -> None:
    def report(stage: str, done: int, total: int | None = None, /, **quantities: object) -> None: ...

    assert progress_or_silence(report) is report
    assert progress_or_silence(None) is silent
    assert not recwarn.list


def test_what_takes_a_second_says_that_it_has_begun(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress()
    progress.starting("diagnose", after=0.3)
    assert capsys.readouterr().err == ""
    time.sleep(0.7)
    progress.close()
    assert re.fullmatch(r" +[01] s  diagnose: starting\n", capsys.readouterr().err)


@pytest.mark.parametrize(("seconds", "text"), [(5.4, "5 s"), (600, "10 min"), (7200, "2.0 h")])
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text
