"""Probabilities of candidates: near the noise, far from it, and of families."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from embodiedreamer_gym.diagnosis.held_out import HeldOut
from embodiedreamer_gym.diagnosis.probabilities import candidate_probabilities, family_probabilities
from embodiedreamer_gym.effects import CATALOGUE

PIECES, SAMPLES, JOINTS = 24, 50, 3


def errors(chi2: np.ndarray) -> HeldOut:
    """Errors of pieces of time with these mean squares (pieces, n)."""
    counts = np.full(chi2.shape, SAMPLES)
    return HeldOut(chi2.mean(axis=0), np.ones(chi2.shape[1]), chi2 * SAMPLES, counts)


def candidate(name: str, chi2: np.ndarray) -> SimpleNamespace:
    """A fitted effect with the same errors on both motions."""
    model = SimpleNamespace(effects=(CATALOGUE[name](),), tree=SimpleNamespace(arms=1))
    return SimpleNamespace(kind=CATALOGUE[name], model=model, held_out=errors(chi2), trained=errors(chi2))


def shares(*candidates: SimpleNamespace, base: float = 9.0) -> np.ndarray:
    without = SimpleNamespace(has_effect=lambda kind: False)
    before = errors(np.full((PIECES, JOINTS), base))
    return candidate_probabilities(
        without,
        (before, before),
        candidates,
        (12.0, 12.0),
        (2, 2),
        np.random.default_rng(0),  # type: ignore[arg-type]
    )


def test_a_candidate_that_fits_is_sure() -> None:
    good, bad = (
        candidate("command_delay", np.ones((PIECES, JOINTS))),
        candidate("payload", np.full((PIECES, JOINTS), 2.0)),
    )
    assert shares(good, bad)[0] > 0.999


def test_equals_share() -> None:
    same = np.ones((PIECES, JOINTS))
    np.testing.assert_allclose(shares(candidate("command_delay", same), candidate("command_lowpass", same)), 0.5)


def test_a_richer_law_has_to_earn_its_parameters() -> None:
    same = np.ones((PIECES, JOINTS))
    plain, rich = shares(candidate("coulomb_friction", same), candidate("stribeck_friction", same))
    assert plain > 0.999 > rich


def test_far_from_the_noise_whole_recordings_are_drawn() -> None:
    """One recording in four speaks for the other effect, by far: its blocks of time are no independent witnesses."""
    rng = np.random.default_rng(1)
    one = 100 + 5 * rng.standard_normal((PIECES, JOINTS))
    other = one + 30.0
    other[: PIECES // 2] = one[: PIECES // 2] - 60.0
    far = shares(candidate("coulomb_friction", one), candidate("torque_bias", other), base=500.0)
    assert 0.05 < far[0] < 0.95


def test_an_error_in_one_piece_of_time_is_evidence() -> None:
    """A limit that is reached once: whatever pieces of time are weighted how, the model without it errs there."""
    exact = np.ones((PIECES, JOINTS))
    once = exact.copy()
    once[3] = 40.0
    assert shares(candidate("torque_saturation", exact), candidate("command_rate_limit", once))[0] > 0.95


def test_families_add_up() -> None:
    members = {"coulomb_friction": 0.71, "stribeck_friction": 0.26, "rotor_inertia": 0.03}
    found = family_probabilities(members, CATALOGUE)
    assert list(found) == ["friction", "rotor_inertia"] and found["friction"] == pytest.approx(0.97)
