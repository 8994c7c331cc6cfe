"""The shares of benchmarks.known_effect."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco")

from benchmarks.known_effect import report


def row(joints: list[str], low: float, fitted: bool = True) -> dict:
    """A case of friction on joint a, found on some joints, its interval from `low` to 2."""
    said = {f"{joint}.torque": {"parameter": "torque", "value": 1.0, "low": low, "high": 2.0} for joint in joints}
    label = {"effects": ["coulomb_friction"], "joints": {"coulomb_friction": ["a"]},
             "values": {"coulomb_friction": {"torque": {"a": 1.0}}}}  # fmt: skip
    found = {"joints": {"coulomb_friction": joints}, "parameters": {"coulomb_friction": said}}
    return {"index": 0, "label": label, "found": found, "servo": [True], "stages": [1.0, 2.0, 3.0], "fitted": fitted}


def test_joints_and_intervals_are_held_against_the_truth_and_failures_are_shown() -> None:
    rows = [row(["a"], 0.5), row(["a", "b"], 1.5), row(["b"], 0.5, fitted=False), {"index": 7, "failed": "Error: no"}]
    every, fitted = report(rows).split("fitted cases")
    assert "failed: case 7, Error: no" in every and "all cases: 3" in every
    assert "1 of 3" in every and "1 of 2" in every  # joints; intervals, of which joint b has no truth
    assert fitted.startswith(": 2") and fitted.count("1 of 2") == 2 and "2 of 2" in fitted
