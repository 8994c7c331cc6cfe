"""Run entries on cases, with one line per answer; an interrupted run is continued."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from embodiedreamer_gym.bench.answers import Answer, answer_row, read_answers, write_prediction
from embodiedreamer_gym.bench.entries import load_entry
from embodiedreamer_gym.bench.task import load_task
from embodiedreamer_gym.errors import EmbodieDreamerError, MissingExtraError
from embodiedreamer_gym.io.cases import WHOLE, Cases
from embodiedreamer_gym.io.files import check_regular, read_json
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.io.shard import Shard


def bench_cases(entries: Sequence[str], folder: Path) -> Cases:
    """The pairs of entry and case to be answered, for a set of cases.

    Raises: EmbodieDreamerError if there is no case.
    """
    about = read_json(folder / "bench.json", what="set of cases")
    found = sorted(path.parent.name for path in (folder / "cases").glob("*/case.json"))
    if not found:
        raise EmbodieDreamerError(f"{folder / 'cases'} holds no case; make some with `embodiedreamer bench make`.")
    digest = about.get("truth_sha256") if isinstance(about, dict) else None
    return Cases(
        {"truth_sha256": digest} if digest else {},
        [{"entry": name, "case": case} for case in found for name in entries],
    )


def run_entries(
    entries: Sequence[str], cases: Path, out: Path, jobs: int = 1, progress: ProgressCallback | None = None,
    shard: Shard = WHOLE,
) -> list[Answer]:  # fmt: skip
    """Answers of entries to the cases of a shard, appended to `out` one by one; those already in it are not repeated.

    Raises: EmbodieDreamerError for an unknown entry, damaged cases, a damaged file of answers or answers to other
    cases.
    """
    for name in entries:
        load_entry(name)
    wanted = bench_cases(entries, cases)
    check_regular(out)
    if out.is_file():
        read_answers(out)
    for _ in wanted.run(partial(_answer_row, cases / "cases", out), out, shard, jobs, (), progress, "answers"):
        pass
    return read_answers(out)


def _answer_row(folder: Path, out: Path, case: Mapping[str, str]) -> dict[str, Any]:
    return answer_row(answer_case(case["entry"], folder / case["case"], out))


def answer_case(name: str, folder: Path, out: Path) -> Answer:
    """One entry's answer to one case, with its predictions written next to `out`; an exception becomes a failed answer.

    Raises: MissingExtraError if the entry needs a package that is not installed.
    """
    task = load_task(folder)
    begun = time.perf_counter()
    try:
        found = load_entry(name)(task)
    except MissingExtraError:
        raise
    except Exception as error:  # also of other libraries: counted as a wrong answer
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer(name, task.case, failed=text[:1000], seconds=round(time.perf_counter() - begun, 3))
    seconds, files = round(time.perf_counter() - begun, 3), {}
    for motion in task.predict:
        if motion.name in found.predictions:
            file = Path(f"{out.stem}_predictions") / name / task.case / f"{motion.name}.csv"
            write_prediction(out.parent / file, motion.time, motion.joints, task.signal, found.predictions[motion.name])
            files[motion.name] = file.as_posix()
    return Answer(name, task.case, found.verdict, found.effects, files, seconds)
