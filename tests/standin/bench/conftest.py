from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.standin.bench import make_stand_in
from embodiedreamer_gym.wrappers import ActionChunk
from tests.standin.bench.played import SEED, STEPS


@pytest.fixture(scope="session")
def aloha() -> Iterator[AlohaEnv]:
    """The environment that the stand-in's bench is the reality of."""
    env = AlohaEnv("PutCupOnMat", obs_type="state", renderer="tiny")
    yield env
    env.close()


@pytest.fixture(scope="session")
def shown(aloha: AlohaEnv) -> np.ndarray:
    """Actions (STEPS, 14) with which the expert puts the cup of SEED on its mat in AlohaEnv."""
    aloha.reset(seed=SEED)
    expert = ScriptedExpert(aloha)
    actions, info = [], {}
    for _ in range(STEPS):
        actions.append(expert.act())
        *_, info = aloha.step(actions[-1])
    assert info["is_success"]
    return np.array(actions)


@pytest.fixture(scope="session")
def bench() -> ActionChunk:
    """The cup, the mat and a robot without effects, seen by nobody."""
    return make_stand_in("PutCupOnMat", chunk=10, pictures="none")
