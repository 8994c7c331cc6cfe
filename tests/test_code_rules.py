"""Rules for the source that a linter does not check."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path
from statistics import median

import pytest

import embodiedreamer_gym
from benchmarks.size import files, size

FILES = files()
FORBIDDEN_CALLS = {"eval", "exec", "__import__"}  # a user's --effects FILE.py is loaded through importlib
FORBIDDEN_IMPORTS = {"pickle", "dill", "cloudpickle", "marshal", "shelve", "yaml", "torchvision", "lpips"}
UNSAFE_ARGUMENTS = {"allow_pickle": True, "weights_only": False}  # numpy.load, torch.load
ROOT = Path(__file__).parents[1]
TEXTS = ("*", "scripts/*", "docs/*", "examples/*", "benchmarks/**/*", "tests/**/*", "embodiedreamer_gym/**/*")
LONGEST = 300  # raw lines
HEAVY = ("torch", "matplotlib", "mujoco", "pybullet")


def broken_rules(source: str) -> list[str]:
    """What the source does that no file of the package may do, with its line."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assert):
            found.append((node.lineno, "assert: raise one of embodiedreamer_gym.errors"))
        elif isinstance(node, ast.Call):
            if isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS:
                found.append((node.lineno, node.func.id))
            for keyword in node.keywords:
                value = keyword.value.value if isinstance(keyword.value, ast.Constant) else None
                if keyword.arg in UNSAFE_ARGUMENTS and value is UNSAFE_ARGUMENTS[keyword.arg]:
                    found.append((node.lineno, f"{keyword.arg}={value}"))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            found += [(node.lineno, f"import {n}") for n in names if n.split(".")[0] in FORBIDDEN_IMPORTS]
    return [f"line {line}: {what}" for line, what in sorted(found)]


def test_every_file_keeps_the_rules() -> None:
    broken = {name: broken_rules(path.read_text()) for name, path in FILES.items()}
    assert {name: offences for name, offences in broken.items() if offences} == {}


def test_files_are_short() -> None:
    lengths = {name: len(path.read_text().splitlines()) for name, path in FILES.items()}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}, "split these"
    assert median(lengths.values()) <= 110


def test_there_are_enough_tests() -> None:
    """Seven lines of tests to ten of the package, without the simulated robot and the search for a camera."""
    assert size()["tests_to_code"] >= 0.7


def test_no_file_has_a_path_of_the_machine_it_was_written_on() -> None:
    folders = "|".join(("home", "root", "Users", "work"))
    absolute = re.compile(rf"(?<![\w.])/(?:{folders})/\w")
    texts = [
        p for folder in TEXTS for p in ROOT.glob(folder) if p.suffix in (".py", ".md", ".toml", ".txt", ".sh", ".json")
    ]
    assert len(texts) > 300
    assert [str(p.relative_to(ROOT)) for p in texts if absolute.search(p.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(
    "source",
    [
        "def f(x):\n    assert x > 0",
        "def f():\n    import pickle",
        "from yaml import safe_load",
        "eval('1')",
        "np.load(path, allow_pickle=True)",
    ],
)
def test_broken_rules_are_caught(source: str) -> None:
    assert len(broken_rules(source)) == 1


def test_import_is_light_and_offline() -> None:
    """Importing the package opens no connection and loads none of the heavy libraries."""
    code = f"""
import sys
def no_network(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "urllib.Request"):
        sys.exit(f"{{event}} {{arguments}}")
sys.addaudithook(no_network)
import embodiedreamer_gym
sys.exit(", ".join(m for m in {HEAVY} if m in sys.modules) or None)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, f"`import embodiedreamer_gym` brings in: {done.stderr}"
    assert done.stdout == ""


def test_the_public_names_are_few() -> None:
    names = embodiedreamer_gym.__all__
    assert len(names) == len(set(names)) <= 25


@pytest.mark.parametrize("name", getattr(embodiedreamer_gym, "__all__", []))
def test_a_public_name_exists_and_says_what_it_is(name: str) -> None:
    value = getattr(embodiedreamer_gym, name)
    if isinstance(value, str):  # __version__
        return
    text = inspect.cleandoc(value.__doc__ or "")
    assert text and not text.startswith(f"{name}("), f"{name} has no docstring of its own"
