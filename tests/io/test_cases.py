"""Lists of cases: the same results however the work is shared and wherever it was interrupted; rows of other work are refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib import parallel_config

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.cases import Cases, key_of
from embodiedreamer_gym.io.results import run_of, write_results
from embodiedreamer_gym.io.shard import Shard

CASES = Cases({"seed": 7, "sizes": (2, 3)}, [{"robot": robot, "number": k} for k in range(5) for robot in ("a", "b")])


def measure(case: Mapping[str, Any]) -> dict[str, Any]:
    """What a case's description alone determines, as NumPy has it."""
    rng = np.random.default_rng([case["seed"], case["number"], case["robot"] == "b"])
    return {"mean": rng.standard_normal(1000).mean(), "at": rng.random(case["sizes"][0])}


def all_of(cases: Cases, *paths: Path, **more: Any) -> list[dict[str, Any]]:
    return list(cases.run(measure, *paths, **more))


def results(cases: Cases, paths: Sequence[Path], folder: Path) -> bytes:
    """The bytes of result.json."""
    rows = cases.read(*paths)
    means = [[row["robot"], row["number"], row["mean"], row["at"]] for row in rows]
    write_results(folder, {"means": means, "cases_sha256": cases.sha256}, run_of(rows))
    return (folder / "result.json").read_bytes()


def run_shards(folder: Path, count: int, jobs: int) -> list[Path]:
    paths = [folder / f"{count}-{number}-{jobs}.jsonl" for number in range(1, count + 1)]
    for number, path in enumerate(paths, 1):
        all_of(CASES, path, shard=Shard(number, count), jobs=jobs)
    return paths


def test_results_are_the_same_to_the_byte_for_any_shards_and_jobs(tmp_path: Path) -> None:
    made = [results(CASES, run_shards(tmp_path, count, jobs), tmp_path / "r")
            for count, jobs in ((1, 1), (2, 1), (4, 1), (11, 1), (1, 2))]  # fmt: skip
    assert len(set(made)) == 1 and len(json.loads(made[0])["means"]) == len(CASES.each)
    run = json.loads((tmp_path / "r" / "run.json").read_text())
    assert run["cases"] == 10 and run["seconds"] > 0 and "cores" in run["machine"][0] and len(run["date"][0]) == 10
    assert list(run) == sorted(run)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 60])
def test_every_case_is_in_one_shard_and_kinds_that_take_turns_are_spread(count: int) -> None:
    items = list(range(40))
    parts = [Shard(number, count).of(items) for number in range(1, count + 1)]
    assert sorted(item for part in parts for item in part) == items
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert Shard(1, count).of(items[:33]) == [item for item in parts[0] if item < 33]  # whatever is appended
    if count in (2, 4):
        assert all({item % count for item in part} == set(range(count)) for part in parts)


@pytest.mark.parametrize("text", ["0/4", "5/4", "1", "1/0", "-1/4", "1/4/2", "a/b", "1.0/4", "", "1/100001", "٣/4"])
def test_what_is_no_shard_is_one_sentence(text: str) -> None:
    with pytest.raises(EmbodieDreamerError, match=r"is not a shard; give I/N such as 1/4.*\.$"):
        Shard.parse(text)


def test_a_shard_is_read_as_it_is_written() -> None:
    assert Shard.parse("3/4") == Shard(3, 4) and str(Shard(3, 4)) == "3/4"


def test_finished_cases_are_not_run_again_and_the_progress_names_them(tmp_path: Path) -> None:
    path, other, said = tmp_path / "new" / "rows.jsonl", tmp_path / "other.jsonl", []
    all_of(CASES, other, shard=Shard(1, 2))
    rows = list(CASES.run(measure, path, also=[other], unit="robots", progress=lambda *a, **k: said.append((a, k))))
    assert [len(CASES.read(one)) for one in (other, path)] == [5, 5] == [5, len(rows)]
    assert (
        said[0] == (("robots", 0, 5), {})
        and said[-1][0] == ("robots", 5, 5)
        and set(said[-1][1]) == {"robot", "number"}
    )
    assert all_of(CASES, path, also=[other, path]) == [] == CASES.missing(path, also=[other])
    assert [(row["number"], row["robot"]) for row in CASES.read(path, other)] == [
        (item["number"], item["robot"]) for item in CASES.each
    ]
    longer = Cases(CASES.settings, [*CASES.each, {"robot": "c", "number": 0}])
    assert longer.missing(path, also=[other]) == [{"robot": "c", "number": 0}]


def test_a_key_is_of_the_description_alone() -> None:
    assert key_of({"a": 1, "b": (2, 3)}) == key_of({"b": [2, 3], "a": 1}) != key_of({"a": 1, "b": [2, 4]})
    assert Cases({}, CASES.each).sha256 != CASES.sha256 != Cases(CASES.settings, CASES.each[::-1]).sha256


def test_a_torn_line_is_left_out_and_removed_and_the_last_row_of_a_case_counts(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    all_of(CASES, path)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:3]) + lines[3][:20])
    assert len(CASES.read(path)) == 3 and len(all_of(CASES, path)) == 7
    assert len(CASES.read(path)) == len(path.read_bytes().splitlines()) == 10
    again = json.loads(lines[0]) | {"mean": 5.0}
    path.write_bytes(b"".join(lines) + json.dumps(again).encode() + b"\n")
    assert CASES.read(path)[0]["mean"] == 5.0


def test_rows_of_other_work_are_refused(tmp_path: Path) -> None:
    path, copy = tmp_path / "rows.jsonl", tmp_path / "copy.jsonl"
    all_of(CASES, path)
    copy.write_bytes(path.read_bytes())
    with pytest.raises(
        EmbodieDreamerError, match=r"copy.jsonl contains the case .* a second time; leave one file out\.$"
    ):
        CASES.read(path, copy)
    for settings, item, said in (
        ({"seed": 8}, CASES.each[0], r"rows.jsonl: line 1 has other settings: seed is 7, not 8; give another file\.$"),
        ({"seed": 7}, {"episode": 0}, r"line 1 is not a row of these cases: KeyError\('episode'\)\.$"),
    ):
        other = Cases(settings, [item])
        with pytest.raises(EmbodieDreamerError, match=said):
            all_of(other, path)
    assert path.read_bytes() == copy.read_bytes()
    older = [{k: v for k, v in row.items() if k != "sizes"} for row in CASES.read(path)]
    path.write_text("".join(json.dumps(row) + "\n" for row in older))
    assert CASES.read(path) == older  # a setting that older rows do not name


@pytest.mark.parametrize(
    "text",
    [
        b"[]\n",
        b"{\n",
        b"\xff\xfe\n",
        b"7\n",
        b'{"robot": "a", "number": 0, "seed": NaN}\n',
        b"[" * 100_000 + b"\n",
        b'{"robot": NaN}\n',
    ],
)
def test_what_is_no_file_of_rows_is_one_sentence(text: bytes, tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_bytes(text)
    with pytest.raises(
        EmbodieDreamerError, match=r"rows.jsonl: line 1 (is not a row of these cases|has other settings): .*\.$"
    ):
        all_of(CASES, path)
    assert path.read_bytes() == text
    with pytest.raises(EmbodieDreamerError, match=r"none.jsonl cannot be read: No such file"):
        CASES.read(tmp_path / "none.jsonl")


def test_an_error_keeps_the_rows_before_it(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    with pytest.raises(ZeroDivisionError):
        list(CASES.run(lambda case: {"share": 1 / (3 - case["number"])}, path))
    assert len(CASES.read(path)) == 6


def test_an_error_before_the_first_row_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        list(CASES.run(lambda case: {"share": 1 / case["number"]}, tmp_path / "rows.jsonl"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("backend", ["threading", "dask"])
def test_other_backends_run_the_cases(backend: str, tmp_path: Path) -> None:
    """Dask: its scheduler and workers on this machine."""
    plain = results(CASES, run_shards(tmp_path, 1, 1), tmp_path / "r")
    path = tmp_path / "rows.jsonl"
    if backend == "dask":
        distributed = pytest.importorskip("distributed")
        options = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
        with distributed.Client(**options), parallel_config(backend="dask"):
            all_of(CASES, path, jobs=-1)
    else:
        with parallel_config(backend=backend):
            all_of(CASES, path, jobs=2)
    assert results(CASES, [path], tmp_path / "r") == plain


def stall(case: Mapping[str, Any], after: int) -> dict[str, Any]:
    """Do so many cases of the list; take a minute for any other."""
    item = {name: case[name] for name in ("robot", "number")}
    if CASES.each.index(item) >= after:
        time.sleep(60)
    return measure(case)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_run_that_is_killed_goes_on_with_the_same_result(tmp_path: Path) -> None:
    """Killed twice, each time with a line half written; a second process beside the first is refused."""
    path, before = tmp_path / "rows.jsonl", {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    for count in (4, 7):
        process = subprocess.Popen([sys.executable, __file__, str(path), str(count)], env=before)
        while not path.exists() or path.read_bytes().count(b"\n") < count:
            assert process.poll() is None
            time.sleep(0.01)
        with pytest.raises(EmbodieDreamerError, match=r"rows.jsonl is being written by another process; give"):
            all_of(CASES, path)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL and len(CASES.read(path)) == count
        with path.open("ab") as file:
            file.write(b'{"seed": 7, "sizes": [2')
    assert len(all_of(CASES, path)) == 3
    assert results(CASES, [path], tmp_path / "a") == results(CASES, run_shards(tmp_path, 1, 1), tmp_path / "b")


if __name__ == "__main__":
    for _ in CASES.run(partial(stall, after=int(sys.argv[2])), Path(sys.argv[1])):
        pass
