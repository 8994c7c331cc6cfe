"""The table of the closed loop: shares with intervals, and what each kind of simulator adds."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.closed_loop import draw, hidden, report
from embodiedreamer_gym.envs.robots import load_robot


def rows(*successes: int) -> list[dict[str, bool]]:
    return [{"success": one == 1, "grasped": one > 0} for one in successes]


def test_what_each_kind_adds(tmp_path: Path) -> None:
    found: dict[tuple[str, str, int], list[dict[str, bool]]] = {
        ("A", "plain", 0): rows(0, 2, 1, 0), ("A", "generated", 0): rows(1, 1, 1, 0),
        ("A", "plain", 1): rows(1, 0, 0, 0), ("A", "generated", 1): rows(1, 1, 1, 1),
        ("B", "plain", 0): rows(0, 0, 0, 0), ("B", "generated", 0): rows(0, 0, 0, 1),
        ("B", "plain", 1): rows(1, 1, 1, 1), ("B", "generated", 1): rows(1, 1, 0, 1),
    }  # fmt: skip
    lines = report(found, ["plain", "generated"]).splitlines()
    assert lines[2].startswith(
        "| A | 25.0% (3.2% .. 65.1%); 1 1; 3 of 8 picked up | 87.5% (47.3% .. 99.7%); 3 4; 7 of 8"
    )
    assert lines[3].startswith("| B | 50.0%")
    assert lines[4] == "generated over plain: +31.2 ± 21.3 points"  # of .5, .75, .25 and -.25
    draw(found, ["plain", "generated"], tmp_path / "bars.png")
    assert (tmp_path / "bars.png").stat().st_size > 5000


def test_the_robot_has_what_is_hidden_in_it() -> None:
    mujoco = pytest.importorskip("mujoco")
    from embodiedreamer_gym.standin.bench.robot import build_robot

    assert mujoco and len(hidden()["coulomb_friction"]["torque"]) == load_robot("aloha").n
    loss = build_robot(hidden()).engine.model.dof_frictionloss
    assert sorted(loss)[-12:] == pytest.approx([0.8] * 12)
