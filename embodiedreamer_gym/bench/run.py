"""Run entries on cases: one line of answers after another, continued where it was interrupted."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from embodiedreamer_gym.bench.answers import Answer, answer_line, read_answers, write_prediction
from embodiedreamer_gym.bench.entries import load_entry
from embodiedreamer_gym.bench.task import load_task
from embodiedreamer_gym.errors import EmbodieDreamerError, MissingExtraError
from embodiedreamer_gym.io.files import check_regular, read_json
from embodiedreamer_gym.io.parallel import each, ended_workers
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence


def case_folders(cases: Path) -> list[Path]:
    """The folders of a set of cases.

    Raises: EmbodieDreamerError where there are none.
    """
    read_json(cases / "bench.json", what="set of cases")
    found = sorted(path.parent for path in (cases / "cases").glob("*/case.json"))
    if not found:
        raise EmbodieDreamerError(f"{cases / 'cases'} holds no case; make some with `embodiedreamer bench make`.")
    return found


def run_entries(
    entries: Sequence[str], cases: Path, out: Path, jobs: int = 1, progress: ProgressCallback | None = None
) -> list[Answer]:
    """Answers of entries to all cases, appended to `out` as they come; those that it holds are not made again.

    Raises: EmbodieDreamerError for an unknown entry, damaged cases or a damaged file of answers.
    """
    report = progress_or_silence(progress)
    for name in entries:
        load_entry(name)
    folders = case_folders(cases)
    check_regular(out)
    before = read_answers(out) if out.is_file() else []
    done = {(answer.entry, answer.case) for answer in before}
    calls = [
        (name, folder, out) for folder in folders for name in dict.fromkeys(entries) if (name, folder.name) not in done
    ]
    answers = list(before)
    report("answering", 0, len(calls))
    with ended_workers(), out.open("a+b") as file:
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)  # a line that an interruption cut short
        for k, answer in enumerate(each(answer_case, calls, jobs), 1):
            file.write(answer_line(answer).encode())
            file.flush()
            answers.append(answer)
            report("answering", k, len(calls), entry=answer.entry, case=answer.case)
    return answers


def answer_case(name: str, folder: Path, out: Path) -> Answer:
    """One entry's answer to one case, its predictions written beside `out`; what it raises becomes a failed answer.

    Raises: MissingExtraError where the entry needs a package that is not installed.
    """
    task = load_task(folder)
    begun = time.perf_counter()
    try:
        found = load_entry(name)(task)
    except MissingExtraError:
        raise
    except Exception as error:  # of another library too: counted as a wrong answer, not hidden
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer(name, task.case, failed=text[:1000], seconds=round(time.perf_counter() - begun, 3))
    seconds, files = round(time.perf_counter() - begun, 3), {}
    for motion in task.predict:
        if motion.name in found.predictions:
            file = Path(f"{out.stem}_predictions") / name / task.case / f"{motion.name}.csv"
            write_prediction(out.parent / file, motion.time, motion.joints, task.signal, found.predictions[motion.name])
            files[motion.name] = file.as_posix()
    return Answer(name, task.case, found.verdict, found.effects, files, seconds)
