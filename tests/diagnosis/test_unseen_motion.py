"""A limit of a two-joint arm that only one of the held-out recordings reaches."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from embodiedreamer_gym.diagnosis import diagnose, search
from embodiedreamer_gym.diagnosis.search_state import SearchState
from embodiedreamer_gym.diagnosis.unseen_motion import contradicted, only_held_out_shows
from embodiedreamer_gym.effects import CATALOGUE
from tests.diagnosis.test_search_state import errors, null, start
from tests.two_joint_arm import load_arm, record, wave

NOISE = 4e-4  # rad
KNOWN = {name: CATALOGUE[name] for name in ("torque_bias", "command_rate_limit", "coulomb_friction")}


def logs(model, sizes, first=0):
    """Waves of several sizes."""
    return [
        record(model, noise=NOISE, seed=first + k, command=size * wave(seed=first + k), name=f"wave_{first + k}")
        for k, size in enumerate(sizes)
    ]


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """The arm, and the same whose shoulder's command is limited to 1.2 rad/s."""
    arm = load_arm(tmp_path_factory.mktemp("arm"))
    limited = arm.with_effect(CATALOGUE["command_rate_limit"], ("shoulder",))
    return arm, limited.with_values({"command_rate_limit.rate": {"shoulder": 1.2}})


def test_one_held_out_recording_is_learned_from_where_only_these_show_the_error(arms) -> None:
    arm, limited = arms
    slow, fast = logs(limited, (0.2, 0.25)), logs(limited, (1.2, 1.6), first=5)
    found = diagnose(arm, slow, fast, catalogue=KNOWN, jobs=1)
    assert found.effects == ("command_rate_limit",) and found.joints["command_rate_limit"] == ("shoulder",)
    assert found.parameters["command_rate_limit"]["shoulder"]["value"] == pytest.approx(1.2, rel=0.02)
    assert any("wave_6 was moved to the training recordings" in note for note in found.notes)
    assert found.learned_from == ("wave_6",) and found.as_dict()["learned_from"] == ["wave_6"]


def test_the_parts_stay_where_the_training_motion_shows_the_error(arms) -> None:
    arm, limited = arms
    found = diagnose(arm, logs(limited, (1.2, 1.6)), logs(limited, (1.2, 1.6), first=5), catalogue=KNOWN, jobs=1)
    assert found.effects == ("command_rate_limit",)
    assert not any("moved to the training recordings" in note for note in found.notes)


def test_the_only_held_out_recording_stays_held_out(arms) -> None:
    arm, limited = arms
    found = diagnose(arm, logs(limited, (0.2, 0.25)), logs(limited, (1.2,), first=5), catalogue=KNOWN, jobs=1)
    assert not any("moved to the training recordings" in note for note in found.notes)


def test_what_no_search_can_find_is_not_searched_for(arms, monkeypatch) -> None:
    module, searches = sys.modules["embodiedreamer_gym.diagnosis.diagnose"], []
    whole = module.search_effects
    monkeypatch.setattr(module, "search_effects", lambda *given: searches.append(given) or whole(*given))
    arm, limited = arms
    found = diagnose(arm, logs(limited, (0.2, 0.25)), logs(limited, (1.2, 1.6), first=5), catalogue=KNOWN, jobs=1)
    assert found.learned_from and len(searches) == 1


def test_a_contradicted_effect_has_a_recording_learned_from(arms, monkeypatch) -> None:
    monkeypatch.setattr(search, "contradicted", lambda searched, state, singles: singles[0])
    arm, limited = arms
    found = diagnose(arm, logs(limited, (1.2, 1.6)), logs(limited, (1.2, 1.6), first=5), catalogue=KNOWN, jobs=1)
    assert found.learned_from


@pytest.mark.parametrize(
    ("trained", "held", "expected"),
    [
        ((1.0, 1.0), (1.0, 9.0), True),  # at the elbow, nothing but held-out motion shows the error
        ((1.0, 9.0), (1.0, 9.0), False),
        ((9.0, 1.0), (9.0, 9.0), True),
        ((1.0, 1.0), (1.0, 3.0), False),  # too little to give up a held-out recording for
    ],
)
def test_an_error_that_only_held_out_motion_shows(trained, held, expected) -> None:
    state = SearchState(start(by_effort=False), errors(*held), errors(*trained), null(2.0, 2))
    assert only_held_out_shows(state) is expected


def fit_of(name: str, cost: float, trained: tuple[float, ...], held: tuple[float, ...]) -> Any:
    """A refitted effect with 7 parameters."""
    found = SimpleNamespace(cost=cost)
    rows = SimpleNamespace(rows=range(7))
    return SimpleNamespace(
        kind=CATALOGUE[name], fit=found, problem=rows, trained=errors(*trained), held_out=errors(*held)
    )


@pytest.mark.parametrize(
    ("trained", "held", "expected"),
    [
        ((1.0, 1.0), (1.0, 40.0), True),
        ((1.0, 1.0), (1.0, 1.0), False),  # held-out motion agrees
        ((1.0, 2.9), (1.0, 40.0), False),  # training motion hardly prefers it
        ((1.0, 3.9), (1.0, 40.0), False),  # it is not exact there
    ],
)
def test_an_effect_that_training_motion_speaks_for_and_held_out_motion_against(trained, held, expected) -> None:
    named = fit_of("torque_saturation", 0.8, (1.0, 3.0), (1.0, 2.0))
    other = fit_of("voltage_limit", 0.7, trained, held)
    begin = (None, SimpleNamespace(rows=range(2), signals=SimpleNamespace(by_effort=False)), None)
    state = SearchState(begin, errors(60.0, 60.0), errors(60.0, 60.0), null(3.0, 2), [named])  # pyright: ignore[reportArgumentType]
    logs = [SimpleNamespace(time=range(4), duration=0.2)]
    search: Any = SimpleNamespace(train=logs, test=logs)
    assert (contradicted(search, state, [named, other]) is other) is expected
