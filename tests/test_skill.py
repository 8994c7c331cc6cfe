"""SKILL.md: its commands, run as they are in a folder with a URDF and csv logs, give the answer that it describes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from embodiedreamer_gym.recordings import save_recording
from tests.two_joint_arm import load_arm, record

ROOT = Path(__file__).parents[1]
MOST_COMMANDS = 5


@pytest.mark.slow
def test_the_commands_of_the_skill_diagnose_csv_logs(tmp_path: Path) -> None:
    arm = load_arm(tmp_path)
    true = arm.with_effect("coulomb_friction").with_values({"coulomb_friction.torque": {"shoulder": 0.6, "elbow": 0.2}})
    (tmp_path / "logs").mkdir()
    names = {"shoulder": "joint1", "elbow": "joint2"}
    for k, name in enumerate(("a1", "a2", "b1", "b2")):
        path = save_recording(record(true, name, 5e-4, seed=k), tmp_path / "logs" / f"{name}.csv")
        path.write_text(re.sub("shoulder|elbow", lambda match: names[match[0]], path.read_text()))
    urdf = (tmp_path / "two.urdf").read_text()
    (tmp_path / "arm.urdf").write_text(re.sub("shoulder|elbow", lambda match: names[match[0]], urdf))

    (block,) = re.findall(r"```bash\n(.*?)```", (ROOT / "SKILL.md").read_text(), re.DOTALL)
    commands = block.strip().splitlines()
    assert len(commands) <= MOST_COMMANDS
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for command in commands:
        done = subprocess.run(
            command, shell=True, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{command}\n{done.stderr[-2000:]}"
    answer = json.loads((tmp_path / "diagnosis.json").read_text())
    assert answer["verdict"] == "missing" and answer["effects"] == ["coulomb_friction"]
    assert answer["joints"]["coulomb_friction"] == ["joint1", "joint2"]
    assert (tmp_path / "better.json").is_file()


def test_the_files_for_assistants_name_what_exists() -> None:
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / "llms.txt").read_text())
    assert len(links) > 10 and [link for link in links if not (ROOT / link).is_file()] == []
    for path in re.findall(r"docs/[\w/]+\.md", (ROOT / "SKILL.md").read_text()):
        assert (ROOT / path).is_file(), path
