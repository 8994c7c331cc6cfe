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
PIP = (sys.executable, "-m", "pip")

pytestmark = pytest.mark.slow


def run(*command: str | Path, cwd: Path) -> str:
    """Output of a command that must succeed, run where the source tree cannot be imported by accident."""
    surroundings = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "DISPLAY")}
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=surroundings, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the source tree, so that no build folder is left in it."""
    folder = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    for name in (NAME, "tests", "benchmarks", "examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built without isolation (no network); `make install` has built the project in isolation before."""
    out = tmp_path_factory.mktemp("wheel")
    run(*PIP, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", out, source, cwd=out)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def sdist(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution, built like the wheel."""
    out = tmp_path_factory.mktemp("sdist")
    run(sys.executable, "-m", "build", "--sdist", "--no-isolation", "-o", out, source, cwd=out)
    return next(out.glob("*.tar.gz"))


def environment_with(distribution: Path, place: Path) -> Path:
    """The Python of a new environment: the distribution, and the third parties of this one (torch takes a minute)."""
    run(sys.executable, "-m", "venv", "--without-pip", place / "venv", cwd=place)
    python = place / "venv" / "bin" / "python"
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=place).strip())
    # After the distribution on the path, and not read for .pth files: an editable installation stays out of sight.
    (site / "third_parties.pth").write_text(sysconfig.get_path("purelib") + "\n")
    options = ("-q", "--no-deps", "--no-index", "--no-build-isolation")
    run(*PIP, "--python", python, "install", *options, distribution, cwd=place)
    location = run(python, "-c", f"import {NAME}; print({NAME}.__file__)", cwd=place).strip()
    assert Path(location).is_relative_to(site)
    return python


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return environment_with(wheel, tmp_path_factory.mktemp("installed"))


@pytest.fixture(scope="module")
def installed_from_source(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return environment_with(sdist, tmp_path_factory.mktemp("installed_from_source"))


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


@pytest.mark.parametrize("kind", ["installed", pytest.param("installed_from_source", marks=pytest.mark.release)])
def test_the_demo_runs_outside_the_checkout(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """What `make demo` runs, from the wheel and from the source distribution."""
    command = request.getfixturevalue(kind).parent / "embodiedreamer"
    text = run(command, "demo", "--quiet", "--out", "report", cwd=tmp_path)
    assert "hidden: stribeck_friction    diagnosed: stribeck_friction" in text
    assert (tmp_path / "report" / "better.json").is_file() and (tmp_path / "report" / "index.html").is_file()
