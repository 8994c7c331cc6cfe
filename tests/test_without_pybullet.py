"""An interpreter without PyBullet: comparison, diagnosis and environments work, on the MuJoCo engine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BLOCKER = 'import sys\nfor name in ("pybullet", "pybullet_data", "pybullet_utils"):\n    sys.modules[name] = None\n'
ENVIRONMENT = """
import gymnasium, warnings
from gymnasium.utils.env_checker import check_env
import embodiedreamer_gym
for options in ({}, {"engine": "mujoco"}):
    env = gymnasium.make("EmbodieDreamer/PutCupOnMat-v0", obs_type="state", **options)
    observation, _ = env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(100):
        observation, reward, *_ = env.step(env.action_space.sample())
    assert observation in env.observation_space and reward < 0
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*symmetric and normalized")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()
from embodiedreamer_gym.errors import EmbodieDreamerError
try:
    gymnasium.make("EmbodieDreamer/PutCupOnMat-v0", engine="bullet")
except EmbodieDreamerError as error:
    assert "PyBullet" in str(error), error
else:
    raise SystemExit("no error")
"""


@pytest.fixture
def run(tmp_path: Path):
    """Run Python with arguments where PyBullet cannot be imported; returns what it printed."""
    (tmp_path / "blocked").mkdir()
    (tmp_path / "blocked" / "sitecustomize.py").write_text(BLOCKER)
    surroundings = {**os.environ, "PYTHONPATH": f"{tmp_path / 'blocked'}{os.pathsep}{ROOT}"}

    def call(*arguments: str) -> str:
        command = [sys.executable, "-W", "error::DeprecationWarning:embodiedreamer_gym", *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=surroundings, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
        return done.stdout

    return call


def test_environments_run_on_the_other_engine(run) -> None:
    run("-c", ENVIRONMENT)


@pytest.mark.slow
def test_comparison_and_calibration_run(run, tmp_path: Path) -> None:
    from embodiedreamer_gym.demo import unpack

    folder = unpack(tmp_path / "demo")
    model = ("--model", str(folder / "model.json"))
    assert "mrad" in run("-m", "embodiedreamer_gym", "compare", *model, str(folder / "test"))
    run("-m", "embodiedreamer_gym", "calibrate", *model, "--quiet", "--out", "better.json", str(folder / "train"))
    assert (tmp_path / "better.json").is_file()


@pytest.mark.slow
def test_the_demo_runs(run) -> None:
    """Which diagnoses."""
    text = run("-m", "embodiedreamer_gym", "demo", "--quiet", "--out", "report")
    assert "hidden: stribeck_friction    diagnosed: stribeck_friction" in text
