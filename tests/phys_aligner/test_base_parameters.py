"""Base parameters: the combinations of masses and inertias that a motion's torques depend on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.effects.inertial_error import InertialError
from embodiedreamer_gym.phys_aligner import calibrate
from embodiedreamer_gym.phys_aligner.base_parameters import combinations
from embodiedreamer_gym.recordings import load_recordings
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import Drive
from embodiedreamer_gym.standin.cases import draw_case


def test_combinations_say_all_of_the_products() -> None:
    """As many as the rank, and the products follow from them; parameters that change nothing are in none."""
    rng = np.random.default_rng(0)
    regressor = rng.standard_normal((200, 3)) @ rng.standard_normal((3, 6))
    regressor[:, 4] = 0.0
    rows = combinations(regressor)
    assert len(rows) == np.linalg.matrix_rank(regressor) == 3
    assert not rows[:, 4].any()
    values = rng.standard_normal(6)
    own = [int(np.flatnonzero(row == 1.0)[0]) for row in rows]
    np.testing.assert_allclose(regressor[:, own] @ (rows @ values), regressor @ values)


def test_a_column_goes_to_those_before_it() -> None:
    columns = np.random.default_rng(0).standard_normal((50, 2))
    rows = combinations(np.column_stack([columns, columns @ [2.0, 3.0]]))
    np.testing.assert_allclose(rows, [[1.0, 0.0, 2.0], [0.0, 1.0, 3.0]], atol=1e-9)


@pytest.fixture(scope="module")
def logs_without_commands(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotModel, Path]:
    folder = tmp_path_factory.mktemp("case")
    drawn = draw_case(None, "arm6", np.random.default_rng([3, 7]), with_command=False)
    return RobotModel.load(drawn.write(folder)), folder


def test_a_calibration_reports_them(logs_without_commands) -> None:
    """Of a six-joint arm there are 36 (Gautier and Khalil, 1990) and the rotors that add to them; the table has no other masses."""
    model, folder = logs_without_commands
    fit = calibrate(model, load_recordings(folder / "train"))
    found = {p.name.split(" ")[0]: p for p in fit.base_parameters}
    assert 36 <= len(fit.base_parameters) <= 42
    assert all(p.urdf is None or np.isfinite([p.urdf, p.value, p.sd]).all() for p in found.values())
    determined = [p for p in found.values() if p.determined]
    assert 5 <= len(determined) < len(found)
    assert all(p.interval[0] < p.value < p.interval[1] for p in determined)
    text = str(fit)
    assert "inertial_error" not in text and determined[0].name in text
    assert len(fit.as_dict()["base_parameters"]) == len(found)
    assert fit.as_dict()["base_parameters"][0]["terms"]


def test_a_wrong_mass_comes_back_in_them(logs_without_commands) -> None:
    """With one link's mass made 15 % heavier in the URDF, the combinations return to what they are by the right one."""
    model, folder = logs_without_commands
    logs = load_recordings(folder / "train")
    right = {p.name: p.value for p in calibrate(model, logs).base_parameters}
    heavier = {"mass": {model.joints[2]: 0.14}}
    wrong = model.with_effect(InertialError(**heavier))
    fit = calibrate(model.with_(tree=_with_masses(model, wrong)), logs)
    determined = [p for p in fit.base_parameters if p.determined and p.name.startswith("m")]
    moved = [p for p in determined if p.urdf is not None and abs(p.urdf - p.value) > 3 * p.sd]
    assert moved
    for p in determined:
        assert abs(p.value - right[p.name]) <= max(3 * p.sd, 0.02 * abs(right[p.name])), p.name


def test_a_fit_of_commands_has_none(tmp_path: Path) -> None:
    drawn = draw_case(None, "arm6", np.random.default_rng([3, 7]))
    fit = calibrate(
        RobotModel.load(drawn.write(tmp_path)), load_recordings(tmp_path / "train")[:1], groups=["damping"], scan=False
    )
    assert fit.base_parameters == () and "base_parameters" not in fit.as_dict()


def _with_masses(model: RobotModel, other: RobotModel):
    """The model's tree with the masses of another's mechanics."""
    m = Drive(other).mechanics
    return replace(model.tree, mass=m.mass[0], first_moment=m.first_moment[0], inertia=m.inertia[0])
