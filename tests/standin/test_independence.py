"""The hidden effects are implemented in MuJoCo independently: they use no law, solver or identification of the package."""

from __future__ import annotations

import pytest

from tests.test_layers import FILES, imported

ROOTS = ("standin.hidden", "standin.engine", "standin.plant", "standin.firmware")
URDF = "robot.urdf"  # the one module outside `standin` that they may use besides `errors`: a reader of URDF files


def reachable(root: str) -> set[str]:
    """Modules of the package that `root` imports, directly or through others, also within functions; not through URDF."""
    reached, pending = set(), [root]
    while pending:
        module = pending.pop()
        if module in reached:
            continue
        reached.add(module)
        for name in imported(FILES[module].read_text()) if module != URDF else ():
            parent = name.rpartition(".")[0]
            candidates = (name, f"{name}.__init__", parent, f"{parent}.__init__")
            pending += next(([one] for one in candidates if one in FILES), [])
    return reached


@pytest.mark.parametrize("root", ROOTS)
def test_hidden_effects_import_no_law_of_the_package(root: str) -> None:
    assert {name for name in reachable(root) if name.split(".")[0] != "standin"} <= {"errors", URDF}


def test_the_walk_finds_laws_where_they_are_imported() -> None:
    packages = {name.split(".")[0] for name in reachable("diagnosis.diagnose")}
    assert {"effects", "simulation", "phys_aligner"} <= packages
