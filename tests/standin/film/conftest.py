from __future__ import annotations

from collections.abc import Iterator

import pytest

from embodiedreamer_gym.standin.film.play import Stage


@pytest.fixture(scope="session")
def stage() -> Iterator[Stage]:
    """A cup, a mat and the robot."""
    made = Stage("PutCupOnMat")
    yield made
    made.close()
