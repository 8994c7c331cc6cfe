"""Every effect of the catalogue against its own hidden twin in another engine, at plain size on all joints."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.null_test import Twin, error, twin
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.motions import multisine
from tests.bank import plain

ARM = "arm6"
FELT = [name for name, kind in CATALOGUE.items() if kind.stage != "clock"]
SECONDS = 1.5
# A corner of the commanded path falls between two steps of the plant, a stick or slip too.
LARGEST = 0.5  # mrad


@lru_cache
def pair() -> Twin:
    return twin(ARM)


@pytest.mark.parametrize("effect", FELT)
def test_both_engines_agree_on_what_an_effect_does(effect: str) -> None:
    model = pair().model
    kind = plain(model, CATALOGUE[effect])
    if effect == "servo_deadzone":  # at the edge of a dead zone that jumps an arm without friction never rests
        kind = CATALOGUE[effect](width=kind.values["width"], jump=dict.fromkeys(kind.values["jump"], 0.0))
    hidden = {name: np.array(list(values.values())) for name, values in kind.values.items()}
    standin = pair().build({effect: hidden}, timestep=2e-4)
    motion = multisine(pair().span, np.random.default_rng(1), SECONDS)
    recording = standin.record(motion, hz=500.0)
    without, _ = error(model, standin, recording, 240.0)
    position, torque = error(model.with_effect(kind), standin, recording, 240.0)
    assert without > LARGEST, "the effect does not show"
    assert position < LARGEST
    assert torque < 2.0
    assert position < 0.1 * without


@pytest.mark.parametrize("robot", ["arm6", "arm7"])
def test_a_faultless_robot_is_the_same_in_both_engines(robot: str) -> None:
    faultless = twin(robot)
    standin = faultless.build()
    recording = standin.record(multisine(faultless.span, np.random.default_rng(0), 2.0), hz=1000.0)
    for rate in (240.0, 250.0):
        position, torque = error(faultless.model, standin, recording, rate)
        assert position < 0.05, "mrad"
        assert torque < 0.03, "sensor noises"
