from __future__ import annotations

from collections.abc import Iterator

import pytest

from embodiedreamer_gym.standin.film.play import EpisodePlayer


@pytest.fixture(scope="session")
def stage() -> Iterator[EpisodePlayer]:
    """A cup, a mat and the robot."""
    made = EpisodePlayer("PutCupOnMat")
    yield made
    made.close()
