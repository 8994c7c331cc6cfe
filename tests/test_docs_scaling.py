"""The SLURM script of docs/scaling.md, its tasks run one after the other on this machine."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from embodiedreamer_gym.bench.cases import make_cases
from embodiedreamer_gym.bench.score import score

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a shell script")
def test_the_array_answers_every_case_once(tmp_path: Path) -> None:
    (script,) = re.findall(r"```bash\n(#!/bin/bash\n.*?)```", (ROOT / "docs" / "scaling.md").read_text(), re.DOTALL)
    assert "#SBATCH --array=" in script
    for name, command in (
        ("srun", 'exec "$@"'),
        ("embodiedreamer", f'exec "{sys.executable}" -m embodiedreamer_gym "$@"'),
    ):
        (tmp_path / name).write_text(f"#!/bin/sh\n{command}\n")
        (tmp_path / name).chmod(0o755)
    cases, truth = tmp_path / "cases", tmp_path / "truth"
    make_cases(cases, truth, 3, 2, ["subset"], ["position"], seconds=1.5)
    env = {
        **os.environ,
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SLURM_ARRAY_TASK_COUNT": "2",
    }
    for task in ("1", "2", "1"):  # a task that is submitted again
        env["SLURM_ARRAY_TASK_ID"] = task
        subprocess.run(["bash", "-c", script], cwd=tmp_path, env=env, check=True, capture_output=True)
    files = sorted(tmp_path.glob("answers-*.jsonl"))
    assert sorted(len(file.read_text().splitlines()) for file in files) == [1, 2]
    assert score(truth, files).run["cases"] == 3
