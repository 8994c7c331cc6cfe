"""Size of the package: non-blank lines by folder, the longest and the median file, tests to code.

python -m benchmarks size [--out FILE.json]

The first figure and the ratio exclude the simulated robot (standin/) and the camera calibration.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from statistics import median
from typing import Any

import embodiedreamer_gym
from embodiedreamer_gym.io.files import write_json
from embodiedreamer_gym.io.tables import layout

PACKAGE = Path(embodiedreamer_gym.__file__).parent
TESTS = Path(__file__).parents[1] / "tests"
NOT_COUNTED = ("standin/", "vis_aligner/camera_calibration/")


def files() -> dict[str, Path]:
    """The package's files by their path in the package."""
    return {path.relative_to(PACKAGE).as_posix(): path for path in sorted(PACKAGE.rglob("*.py"))}


def lines(paths: Iterable[Path]) -> int:
    """Number of non-blank lines in files."""
    return sum(bool(line.strip()) for path in paths for line in path.read_text(encoding="utf-8").splitlines())


def size() -> dict[str, Any]:
    """All figures; folders: non-blank lines of the package's folders, largest first, of all files."""
    known = files()
    raw = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in known.items()}
    longest = max(raw, key=raw.__getitem__)
    counted = lines(path for name, path in known.items() if not name.startswith(NOT_COUNTED))
    folders = Counter[str]()
    for name, path in known.items():
        folders[name.partition("/")[0] if "/" in name else "(top)"] += lines([path])
    tests = lines(TESTS.rglob("*.py"))
    return {"lines": counted, "all_lines": lines(known.values()), "files": len(known), "longest": [longest, raw[longest]],
            "median": median(raw.values()), "tests": tests, "tests_to_code": round(tests / counted, 3),
            "folders": dict(folders.most_common())}  # fmt: skip


def main(argv: list[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", metavar="FILE.json")
    a = parser.parse_args(argv)
    found = size()
    name, length = found["longest"]
    print(f"{found['lines']:,} non-blank lines without {' and '.join(NOT_COUNTED)} ({found['all_lines']:,} with them) "
          f"in {found['files']} files; target 20,000")  # fmt: skip
    print(f"longest file {length} ({name}), median {found['median']:g} lines; "
          f"tests to code {found['tests_to_code']:.2f} ({found['tests']:,} non-blank lines)\n")  # fmt: skip
    print(layout(["folder", "lines"], [[folder, f"{count:,}"] for folder, count in found["folders"].items()]))
    if a.out:
        write_json(found, a.out)


if __name__ == "__main__":
    main()
