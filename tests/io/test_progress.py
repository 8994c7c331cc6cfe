"""Progress of long work: named quantities on stderr, and callbacks of the former form."""

from __future__ import annotations

import pytest

from embodiedreamer_gym.io.progress import Progress, progress_or_silence, silent


def test_a_line_names_stage_steps_and_quantities(capsys) -> None:
    progress = Progress()
    progress("screening effects", 7, 24, residual="1.45 chi2/n")
    progress("training", 3, loss=0.5)
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith("s  screening effects: 7 of 24, residual 1.45 chi2/n")
    assert second.endswith("s  training: step 3, loss 0.5")


def test_quiet_prints_nothing(capsys) -> None:
    Progress(quiet=True)("training", 1, 2)
    assert capsys.readouterr().err == ""


def test_no_callback_is_silent() -> None:
    assert progress_or_silence(None) is silent


def test_a_callback_takes_quantities_as_keywords() -> None:
    calls = []
    progress = progress_or_silence(lambda stage, done, total=None, **quantities: calls.append((stage, quantities)))
    progress("fit", 1, 2, error="3 mrad")
    assert calls == [("fit", {"error": "3 mrad"})]


def test_a_callback_of_the_former_form_still_works_with_a_warning() -> None:
    calls = []
    with pytest.warns(DeprecationWarning, match="progress is called as"):
        progress = progress_or_silence(lambda stage, step, value: calls.append((stage, step, value)))
    progress("fit", 1, 2, error="3 mrad")
    progress("fit", 2)
    assert calls == [("fit", 1, 2.0), ("fit", 2, 0.0)]
