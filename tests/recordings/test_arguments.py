"""Recordings as arguments: one, several, or something else."""

from __future__ import annotations

import pytest

from embodiedreamer_gym import calibrate, compare, diagnose
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.diagnosis import add_effect
from embodiedreamer_gym.errors import RecordingError
from embodiedreamer_gym.recordings import as_recordings, load_recordings
from embodiedreamer_gym.robot import RobotModel


def test_one_recording_is_enough() -> None:
    model, logs = RobotModel.load(DATA / "model.json"), load_recordings(DATA / "test")
    assert as_recordings(logs[0]) == (logs[0],)
    assert as_recordings(logs) == as_recordings(iter(logs)) == tuple(logs)
    assert str(compare(model, logs[0])) == str(compare(model, [logs[0]]))


def test_paths_are_refused() -> None:
    model, path = RobotModel.load(DATA / "model.json"), str(DATA / "test")
    logs = load_recordings(path)
    for call in (
        lambda: compare(model, path), lambda: calibrate(model, DATA), lambda: diagnose(model, logs, path),
        lambda: diagnose(model, [path], logs), lambda: add_effect(model, "coulomb_friction", path, logs),
        lambda: compare(model, 3),
    ):  # fmt: skip
        with pytest.raises(RecordingError, match="is not a recording; read logs with load_recordings"):
            call()
