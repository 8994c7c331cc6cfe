"""Effects that resemble the best one are fitted to the end, and payloads are also fitted from nominal gains."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.add_effect import add_effect
from embodiedreamer_gym.diagnosis.candidates import begin_refit, finish_refit, single_trial
from embodiedreamer_gym.diagnosis.one_effect import calibrated
from embodiedreamer_gym.diagnosis.refit_cache import RefitCache
from embodiedreamer_gym.diagnosis.refits import finish_similar
from embodiedreamer_gym.diagnosis.screening import screen_effect
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.io.progress import silent
from tests.two_joint_arm import load_arm, record

NOISE = 3e-4  # rad


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return load_arm(tmp_path_factory.mktemp("arm"))


def test_a_similar_effect_is_fitted_to_the_end_before_another_is_preferred(arm) -> None:
    """Both joints are late by 60 ms; the lookahead is fitted to the end, the delay was given up at its start."""
    truth = arm.with_effect("command_delay").with_values({"command_delay.seconds": dict.fromkeys(arm.joints, 0.06)})
    train, test = ([record(truth, noise=NOISE, seed=seed) for seed in seeds] for seeds in ((0, 1), (2,)))
    base = calibrated(arm, train, test, silent)
    trials = []
    for name in ("lookahead", "command_delay", "coulomb_friction"):
        screened = screen_effect(CATALOGUE[name], base.points, base.short, np.ones(arm.n))
        trials.append(single_trial(base.calibration.model, replace(screened, joints=None), base.short.hold, False))
    begun = [begin_refit(trial, train, test, 0) for trial in trials]
    candidates = [finish_refit(trials[0], begun[0], test, 12), *begun[1:]]
    assert not begun[1].fit.converged and begun[1].fit.cost > candidates[0].fit.cost
    search = SimpleNamespace(cache=RefitCache(None, arm, [*train, *test], []), train=train, test=test, jobs=1, rollouts=0, progress=silent,
                             milli=str)  # fmt: skip
    lookahead, delay, friction = finish_similar(search, trials, candidates)
    assert lookahead is candidates[0] and friction is candidates[2]  # friction does not resemble a lookahead
    assert delay.fit.cost < lookahead.fit.cost and search.rollouts > 0
    found = delay.model.effects[0].values["seconds"]
    assert found == pytest.approx(dict.fromkeys(arm.joints, 0.06), abs=0.004)


def test_a_payload_is_found_although_the_calibrated_gains_have_compensated_for_it(arm) -> None:
    """The stated gains are 15 % off; the calibration lowers all gains, and every start near them is worse than none."""
    loaded = arm.with_effect("payload").with_values({"payload.mass": {"tip": 0.8}, "payload.x": {"tip": 0.06}})
    train, test = ([record(loaded, noise=NOISE, seed=seed, effort=False) for seed in seeds] for seeds in ((0, 1), (2,)))
    stated = arm.with_(stiffness=arm.stiffness * [0.85, 1.15], damping=arm.damping * [1.1, 0.9])
    found = add_effect(stated, "payload", train, test)
    assert found.before.model.stiffness[1] < 0.8 * arm.stiffness[1]
    assert found.after.model.effects[0].values["mass"]["tip"] == pytest.approx(0.8, rel=0.1)
    assert found.after.model.stiffness == pytest.approx(arm.stiffness, rel=0.1)
