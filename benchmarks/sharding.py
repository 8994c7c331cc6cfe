"""Shards: speed-up of several processes on the same cases, and whether `result.json` is byte-identical.

python -m benchmarks sharding [--fits 12] [--shards 1 2] [--out FILE.json]

The cases are the fits of `benchmarks.intervals`, four for each of --fits. Each shard is one process with one thread;
all run in parallel. In addition to the wall-clock ratio, the ratio of processor time (first run to largest shard) is
given; it is the speed-up on an otherwise idle machine. Both include loading the packages and reading Numba's cache.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.common import save, times


def run_shards(folder: Path, fits: int, count: int) -> dict[str, Any]:
    """Run `count` processes in parallel: wall-clock seconds, processor seconds of each, bytes of their result."""
    rows = [folder / f"{count}-{number}.jsonl" for number in range(1, count + 1)]
    command = [sys.executable, "-m", "benchmarks.intervals", "--jobs", "1", "--fits", str(fits)]
    begun = time.perf_counter()
    started = [
        subprocess.Popen([*command, "--out", str(path), "--shard", f"{number}/{count}"], stdout=subprocess.DEVNULL)
        for number, path in enumerate(rows, 1)
    ]
    used = []
    for process in started:
        _, status, usage = os.wait4(process.pid, 0)
        if status != 0:
            raise SystemExit(f"shard of {count} has failed with status {status}.")
        used.append(round(usage.ru_utime + usage.ru_stime, 2))
    wall = round(time.perf_counter() - begun, 2)
    merged = [*command, "--out", str(rows[0]), "--rows", *map(str, rows[1:]), "--results", str(folder / str(count))]
    subprocess.run(merged, check=True, stdout=subprocess.DEVNULL)
    return {
        "shards": count,
        "wall": wall,
        "processor": used,
        "result": (folder / str(count) / "result.json").read_bytes(),
    }


def main() -> None:
    """Print a line for each number of shards."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--fits", type=times, default=12)
    parser.add_argument("--shards", type=times, nargs="+", default=[1, 2])
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    runs: list[dict[str, Any]] = []
    print(f"{4 * a.fits} cases; load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"{'shards':>6}{'wall s':>9}{'times':>7}{'processor s of the largest':>28}{'times':>7}  result.json")
    with tempfile.TemporaryDirectory() as folder:
        for count in a.shards:
            runs.append(run := run_shards(Path(folder), a.fits, count))
            same = "the same bytes" if run["result"] == runs[0]["result"] else "DIFFERS"
            most, first = max(run["processor"]), max(runs[0]["processor"])
            print(f"{count:>6}{run['wall']:>9.1f}{runs[0]['wall'] / run['wall']:>7.2f}{most:>28.1f}{first / most:>7.2f}  {same}",
                  flush=True)  # fmt: skip
    save([{key: value for key, value in run.items() if key != "result"} for run in runs], a.out)


if __name__ == "__main__":
    main()
