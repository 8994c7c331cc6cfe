"""The built wheel is complete, and works where the source tree is not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NAME = "embodiedreamer_gym"


def run(*command: str | Path, cwd: Path) -> str:
    """Output of a command that must succeed, run where the source tree cannot be imported by accident."""
    surroundings = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "DISPLAY")}
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=surroundings, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy so that no build folder is left in the source tree.

    Without build isolation (no network); `make install` has built the project in isolation before.
    """
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in (NAME, "tests", "benchmarks", "examples"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    run(
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "-q",
        "--no-deps",
        "--no-build-isolation",
        "-w",
        out,
        source,
        cwd=out,
    )
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment: the wheel, and the third parties of this one (torch alone takes a minute)."""
    place = tmp_path_factory.mktemp("installed")
    run(sys.executable, "-m", "venv", "--without-pip", place / "venv", cwd=place)
    python = place / "venv" / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python)
    run(*pip, "install", "-q", "--no-deps", "--no-index", wheel, cwd=place)
    site = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=place).strip()
    # After the wheel on the path, and not read for .pth files: an editable installation stays out of sight.
    Path(site, "third_parties.pth").write_text(sysconfig.get_path("purelib") + "\n")
    where = run(python, "-c", f"import {NAME}; print({NAME}.__file__)", cwd=place).strip()
    assert Path(where).is_relative_to(site)
    return python


def test_the_wheel_holds_every_file_and_nothing_else(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    source = {p for p in (ROOT / NAME).rglob("*") if p.is_file() and "__pycache__" not in p.parts}
    assert {str(p.relative_to(ROOT)) for p in source} - names == set()
    information = f"{NAME}-{wheel.name.split('-')[1]}.dist-info"
    assert {n.split("/")[0] for n in names} == {NAME, information}
    assert any(n.endswith("licenses/LICENSE") for n in names)


def test_the_console_script_answers(installed: Path) -> None:
    assert "usage: embodiedreamer" in run(installed.parent / "embodiedreamer", "--help", cwd=installed.parent)


def test_every_built_in_robot_loads(installed: Path) -> None:
    code = f"""
from importlib.resources import files
from {NAME} import RobotModel
names = sorted(f.name.removesuffix(".json") for f in files("{NAME}").joinpath("assets").iterdir()
               if f.name.endswith(".json"))
for name in names:
    print(name, len(RobotModel.load(name).joints))
"""
    loaded = run(installed, "-c", code, cwd=installed.parent).splitlines()
    assert loaded, "the wheel holds no robot"


@pytest.mark.slow
def test_it_makes_an_environment(installed: Path) -> None:
    """Without a display, a network or the source tree: 100 steps with pictures, and some of each other task."""
    code = f"""
import sys
def no_network(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "urllib.Request"):
        raise RuntimeError(f"{{event}} {{arguments}}")
sys.addaudithook(no_network)
import gymnasium
from {NAME}.envs import NAMES
for name in NAMES:
    env = gymnasium.make(f"{NAME}:EmbodieDreamer/{{name}}-v0")
    observation, info = env.reset(seed=0)
    for _ in range(100 if name == NAMES[0] else 3):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert observation in env.observation_space and observation["pixels"].std() > 10 and reward < 0
    env.close()
"""
    run(installed, "-W", "error::UserWarning", "-c", code, cwd=installed.parent)


def test_it_simulates(installed: Path) -> None:
    code = f"""
import numpy
from {NAME}.robot import RobotModel
from {NAME}.engines.bullet.plant import BulletPlant
model = RobotModel.load("aloha")
with BulletPlant(model) as plant:
    plant.reset(numpy.zeros(14), numpy.zeros(14), numpy.zeros(14))
    for _ in range(10):
        plant.step(numpy.zeros(14))
    assert numpy.isfinite(plant.measured).all()
"""
    run(installed, "-c", code, cwd=installed.parent)
