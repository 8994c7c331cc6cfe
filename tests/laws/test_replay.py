"""A diagnosis is only as good as the file it leaves: replayed in PyBullet, B.json gives the error it promised."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.replay import TOLERANCE, round_trip
from embodiedreamer_gym.diagnosis import diagnose
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.recordings.segments import window
from tests.bank import case, plain


def test_a_diagnosed_model_replays_as_compared(tmp_path: Path) -> None:
    robot, model = case("joint_spring", "pendulum1", seed=1)
    few = {name: CATALOGUE[name] for name in ("joint_spring", "coulomb_friction")}
    found = diagnose(model, robot.train, robot.test, catalogue=few, jobs=1)
    assert found.effects == ("joint_spring",)
    result = round_trip(found.model, robot.test, tmp_path)
    assert result.effects == ("joint_spring",)
    assert result.gap < TOLERANCE < result.gap_without
    assert result.holds


@pytest.mark.parametrize("effect", CATALOGUE)
def test_any_effect_replays_as_compared(effect: str, tmp_path: Path) -> None:
    """On six joints, whatever the effect: the file of a model that has it carries it into PyBullet."""
    robot, model = case(None, "arm6")
    richer = model.with_effect(plain(model, CATALOGUE[effect]))
    result = round_trip(richer, [window(robot.train[0], 0.0, 1.5)], tmp_path)
    assert result.gap < 1e-6
    assert CATALOGUE[effect].stage == "clock" or result.gap_without > TOLERANCE
    assert np.all(result.compared > 0)
