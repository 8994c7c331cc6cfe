"""Arms that the tests of the stand-in share."""

from dataclasses import asdict

import numpy as np
import pytest

from embodiedreamer_gym.motions import Motion, Span
from embodiedreamer_gym.standin.arms import TRUTH, arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.robot import StandIn
from embodiedreamer_gym.standin.span import span_of


@pytest.fixture
def build():
    """Make a stand-in of an arm; keywords replace what it is."""

    def make(arm: str = "pendulum1", **changes) -> StandIn:
        given = {**asdict(TRUTH[arm]), "timestep": 2e-4, **changes}
        return StandIn(arm_urdf(arm), arm_joints(arm), **given)

    return make


@pytest.fixture
def span():
    """The room of an arm's motions."""

    def make(arm: str = "arm6") -> Span:
        return span_of(arm_urdf(arm), arm_joints(arm), arm_home(arm))

    return make


@pytest.fixture
def moves():
    """Simple motions of one joint."""

    class Moves:
        @staticmethod
        def hold(*q: float, seconds: float = 0.5) -> Motion:
            return Motion(lambda t: np.tile(np.array(q, float), (len(t), 1)), seconds, "hold")

        @staticmethod
        def ramp(start: float, speed: float, seconds: float) -> Motion:
            return Motion(lambda t: (start + speed * t)[:, None], seconds, "ramp")

        @staticmethod
        def step(start: float, size: float, seconds: float = 1.5) -> Motion:
            return Motion(lambda t: (start + size * (t >= 0.1))[:, None], seconds, "step")

    return Moves
