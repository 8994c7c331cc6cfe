"""A two-joint arm and a trajectory for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from tests.two_joint_arm import load_arm

HZ = 50.0


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """The faultless arm."""
    folder: Path = tmp_path_factory.mktemp("arm")
    return load_arm(folder)


@pytest.fixture(scope="session")
def wanted() -> Recording:
    """Positions (T, 2) that begin at rest, go to and fro and end at rest."""
    time = np.arange(0.0, 2.0, 1 / HZ)
    window = np.clip(np.minimum(time - 0.1, 1.9 - time) / 0.3, 0.0, 1.0)
    window = window**3 * (10 - 15 * window + 6 * window**2)
    place = 0.12 * window[:, None] * np.stack([np.sin(5 * time), np.cos(4 * time)], axis=1)
    return Recording("wanted", ("shoulder", "elbow"), time, place + np.array([0.4, 0.5]), command_hold="linear")
