"""The demo: held-out errors, noise and verdict of `embodiedreamer demo`.

python -m benchmarks demo [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

from benchmarks.common import save
from embodiedreamer_gym.demo import run


def main() -> None:
    """Run the demo in a scratch folder; it prints its steps."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        run(folder)
        seconds = time.perf_counter() - begun
        found = json.loads(Path(folder, "diagnosis.json").read_text())
    rows = {"error": found["error"], "verdict": found["verdict"], "effects": found["effects"], "seconds": seconds}
    save(rows, a.out)


if __name__ == "__main__":
    main()
