"""The fuzzer: each kind of fault is found and can be seen again; cases follow from their number alone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from random import Random

import numpy as np
import pytest

import embodiedreamer_gym.cli as cli
from benchmarks import fuzz
from benchmarks.fuzzing import texts
from benchmarks.fuzzing.arrays import change_array
from benchmarks.fuzzing.case import Case, Found, Result
from benchmarks.fuzzing.files import mutate
from benchmarks.fuzzing.modules import source
from benchmarks.fuzzing.process import Limits, Running
from embodiedreamer_gym.errors import ModelError

LIMITS = Limits(3.0, 100 << 20)


def refuse() -> None:
    raise ModelError("model two.json: no.")


def command(case: Case, code: int, text: str, left: str = "") -> None:
    """A command that prints a text, leaves a file, and ends with a code."""

    def main(words: list[str]) -> int:
        if left:
            (case.out / left).write_text("half")
        print(text, file=sys.stderr)
        return code

    cli.main = main  # of the case's own process
    case.command("verb")


def unnamed(case: Case) -> None:
    case.about(Path("log.csv"))
    case.library("load", refuse)


FAULTS = {
    "ok": lambda case: case.library("load", lambda: None),
    "refused": lambda case: case.library("load", refuse),
    "unclear": unnamed,
    "traceback": lambda case: case.library("load", lambda: {}["planted"]),
    "half-written": lambda case: command(case, 2, "error: no.", "model.json"),
    "hang": lambda case: time.sleep(60),
    "memory": lambda case: case.library("load", lambda: np.ones(2 * LIMITS.memory // 8).sum()),
    "dead": lambda case: os.kill(os.getpid(), signal.SIGSEGV),
}


@pytest.mark.parametrize("verdict", FAULTS)
def test_a_planted_fault_is_found(verdict: str, tmp_path: Path) -> None:
    (one,) = fuzz.run([("planted", 7)], tmp_path, tmp_path, limits=LIMITS, known={"planted": FAULTS[verdict]})
    assert one.verdict == verdict, one
    text = fuzz.shown([one], 3)
    assert ("python -m benchmarks.fuzz --seed 3 --only planted:7" in text) == (verdict not in ("ok", "refused"))
    assert [row["cases"] for row in fuzz.table([one])] == [1, 1]
    assert not (tmp_path / "planted-7").exists()


def test_a_peak_of_memory_is_seen_after_it_has_gone(tmp_path: Path) -> None:
    """Nobody polls while the cases run, as on a busy machine; what is freed again counts."""
    grown = []
    for number, size in enumerate((0, 2 * LIMITS.memory)):
        case = Running(
            "planted", number, 0, lambda case, size=size: np.ones(size // 8).sum(), tmp_path, tmp_path, LIMITS
        )
        os.waitid(os.P_PID, case.pid, os.WEXITED | os.WNOWAIT)
        result = case.poll()
        assert result is not None and result.verdict == ("memory" if size else "ok"), result
        grown.append(result.megabytes)
    assert grown[1] - grown[0] >= 0.95 * 2 * LIMITS.memory / 2**20


@pytest.mark.parametrize(
    ("code", "text", "verdict"),
    [(0, "", "ok"), (2, "error: no.", "refused"), (2, "no.", "unclear"), (2, "error: a\nerror: b", "unclear"),
     (1, "error: no.", "unclear"), (130, "interrupted", "ok")],
)  # fmt: skip
def test_how_a_command_has_to_end(code: int, text: str, verdict: str, tmp_path: Path) -> None:
    known = {"planted": lambda case: command(case, code, text)}
    (one,) = fuzz.run([("planted", 0)], tmp_path, tmp_path, limits=LIMITS, known=known)
    assert one.verdict == verdict, one


@pytest.mark.parametrize(
    "change", ["change_bytes", "change_csv", "change_json", "change_xml", "change_numbers", "change_words"]
)
def test_a_mutation_follows_from_its_number(change: str) -> None:
    text = {"change_csv": "time,a.position\n0.0,1.5\n0.1,2.5\n", "change_json": '{"a": [1, {"b": "c"}], "d": 0.5}'}.get(
        change,
        '<robot name="two">\n<link name="base"/>\n<joint name="a"><limit lower="-3" upper="3"/></joint>\n</robot>\n',
    )
    data = text.encode() if change == "change_bytes" else text
    made = [getattr(texts, change)(data, Random(f"0:x:{k}")) for k in range(60)]
    assert made == [getattr(texts, change)(data, Random(f"0:x:{k}")) for k in range(60)]
    assert len({str(one) for one in made}) > 10 and made.count(data) < 20


def test_files_modules_and_arrays_are_mutated(tmp_path: Path) -> None:
    kinds = set()
    for k in range(600):
        path = tmp_path / f"{k}.json"
        path.write_text('{"a": 1}')
        mutate(path, Random(k))
        kinds.add(
            "folder"
            if path.is_dir()
            else "link"
            if path.is_symlink()
            else "fifo"
            if path.is_fifo()
            else "file"
            if path.exists()
            else "none"
        )
    assert kinds == {"folder", "link", "fifo", "file", "none"}
    assert len({source(Random(k)) for k in range(100)}) > 40
    arrays = [change_array(np.ones((3, 2)), Random(k)) for k in range(100)]
    assert len({(a.dtype, a.shape) for a in arrays}) > 8


def test_an_interrupted_run_goes_on_and_shards_give_the_same_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = []
    monkeypatch.setattr(fuzz, "targets", lambda: {"a": FAULTS["ok"], "b": FAULTS["traceback"]})
    monkeypatch.setattr(fuzz, "prepare", lambda folder, names: folder)
    monkeypatch.setattr(fuzz, "Running", lambda *arguments: ran.append(arguments[:2]) or Running(*arguments))
    out, folder = tmp_path / "f.jsonl", tmp_path / "results"
    first = Result("a", 0, "traceback", 0.1, 0.0, [Found("load", "traceback", "KeyError", "x.py:1")])
    out.write_text(json.dumps({"seed": 0, **vars(first)}, default=vars) + '\n{"target": "b", "num')
    options = ["--cases", "4", "--out", str(out), "--results", str(folder)]
    assert fuzz.main(options) == 1
    assert sorted(ran) == [("a", 1), ("b", 0), ("b", 1)]
    written = (folder / "result.json").read_bytes()
    rows = {row["target"]: row for row in json.loads(written)["table"]}
    assert (rows["a"]["ok"], rows["a"]["tracebacks"], rows["b"]["tracebacks"], rows["all"]["cases"]) == (1, 1, 2, 4)
    ran.clear()
    assert fuzz.main(options) == 1 and not ran and (folder / "result.json").read_bytes() == written
    parts = [tmp_path / "1.jsonl", tmp_path / "2.jsonl"]
    parts[0].write_text(out.read_text().splitlines()[0] + "\n")
    for number, part in enumerate(parts, 1):
        also = ["--rows", str(parts[0]), "--results", str(folder)] if number == 2 else []
        fuzz.main(["--cases", "4", "--out", str(part), "--shard", f"{number}/2", *also])
    assert sorted(ran) == [("a", 1), ("b", 0), ("b", 1)] and (folder / "result.json").read_bytes() == written
    with pytest.raises(SystemExit) as stop:
        fuzz.main([*options, "--seed", "1"])
    assert stop.value.code == 2 and "has other settings: seed is 0, not 1" in capsys.readouterr().err


@pytest.mark.parametrize("each", [pytest.param(2, marks=pytest.mark.slow), pytest.param(8, marks=pytest.mark.release)])
def test_a_few_cases_of_each_target_are_taken_or_refused(each: int) -> None:
    """In a process of its own, as a fork of this one would have its threads."""
    names = sorted(set(fuzz.targets()))
    ended = subprocess.run(
        [sys.executable, "-m", "benchmarks.fuzz", "--targets", ",".join(names), "--cases", str(each * len(names))],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[1],
    )
    assert ended.returncode == 0, ended.stdout[-3000:] + ended.stderr[-2000:]
    assert all(f"{name} " in ended.stdout for name in names)
