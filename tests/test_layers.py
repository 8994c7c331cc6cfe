"""The packages are layers: imports go downward only, and packages of one layer do not import each other."""

from __future__ import annotations

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

import embodiedreamer_gym

NAME = "embodiedreamer_gym"
PACKAGE = Path(embodiedreamer_gym.__file__).parent
TOP = 11
LAYERS = {
    "errors": -1,  # below all layers: every package may import it
    "io": 0,
    **dict.fromkeys(["geometry", "learning", "motions", "recordings"], 1),
    **dict.fromkeys(["effects", "vis_aligner"], 2),
    "robot": 3,
    **dict.fromkeys(["policies", "simulation"], 4),
    **dict.fromkeys(["engines", "phys_aligner", "tracking"], 5),
    "envs": 6,
    **dict.fromkeys(["diagnosis", "wrappers"], 7),
    **dict.fromkeys(["demo", "pipelines", "standin"], 8),
    **dict.fromkeys(["bench", "workbench"], 9),
    "cli": 10,
    **dict.fromkeys(["__init__", "__main__"], TOP),
}
FILES = {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path for path in sorted(PACKAGE.rglob("*.py"))}


def imported(source: str) -> Iterator[str]:
    """Every module or name the source imports, wherever in the file, without the package's own name."""
    for node in ast.walk(ast.parse(source)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            names = ["relative"] if node.level else names
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in (
            "import_module",
            "__import__",
        ):
            names = [str(arg.value) for arg in node.args[:1] if isinstance(arg, ast.Constant)]
        for name in names:
            if name == "relative" or name.split(".")[0] == NAME:
                yield name.removeprefix(NAME).removeprefix(".") or "__init__"


def offences(module: str, source: str) -> list[str]:
    """What the source of `module` (dotted, below the package) imports against the rules."""
    here, found = module.split(".")[0], []
    for name in imported(source):
        there = name.split(".")[0]
        there = there if there in LAYERS else "__init__"  # a public name of the package itself
        if name == "relative":
            found.append(f"{module}: relative import")
        elif there != here and LAYERS[there] >= LAYERS[here]:
            found.append(f"{module} (layer {LAYERS[here]}) imports {name} (layer {LAYERS[there]})")
    return found


def test_every_module_has_a_layer() -> None:
    units = {module.split(".")[0] for module in FILES}
    assert units <= set(LAYERS), f"give these a layer: {sorted(units - set(LAYERS))}"


def test_imports_go_downward_only() -> None:
    assert [offence for module, path in FILES.items() for offence in offences(module, path.read_text())] == []


def test_no_import_cycles() -> None:
    """Among the modules themselves; the `__init__` that only re-export them are left out."""
    modules = {m for m in FILES if not m.endswith("__init__")}
    graph = {m: {n for i in imported(FILES[m].read_text()) for n in (i, i.rpartition(".")[0])} for m in modules}
    graphlib.TopologicalSorter({m: seen & modules - {m} for m, seen in graph.items()}).prepare()


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("effects.payload", "from embodiedreamer_gym.robot.model import RobotModel"),
        ("effects.payload", "def f():\n    import embodiedreamer_gym.engines.bullet.plant"),
        ("policies.act", "if TYPE_CHECKING:\n    from embodiedreamer_gym import engines"),
        ("recordings.hdf5", "from embodiedreamer_gym import geometry"),
        ("envs.aloha", "import numpy\nfrom embodiedreamer_gym import calibrate"),
        ("wrappers.video", "importlib.import_module('embodiedreamer_gym.diagnosis')"),
        ("robot.model", "from . import io"),
        ("errors", "import embodiedreamer_gym.geometry.pose_error"),
    ],
)
def test_an_offence_is_caught(module: str, source: str) -> None:
    assert len(offences(module, source)) == 1


def test_the_permitted_is_not_an_offence() -> None:
    source = "import numpy\nfrom embodiedreamer_gym.errors import ModelError\nimport embodiedreamer_gym.robot.io"
    assert offences("robot.model", source) == []
