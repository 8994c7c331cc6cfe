"""Which build of PyBullet is installed."""

from __future__ import annotations

import warnings

import pytest

client = pytest.importorskip("embodiedreamer_gym.engines.bullet.client")


@pytest.mark.parametrize(("builds", "warns"), [(["pybullet"], False), (["pybullet", "pybullet-arm64"], True)])
def test_two_builds_of_one_module_are_a_warning(
    builds: list[str], warns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client.metadata, "distributions", lambda name: [name] if name in builds else [])
    assert client.installed_builds() == builds
    if warns:
        with pytest.warns(RuntimeWarning, match="pip uninstall pybullet pybullet-arm64"):
            client.warn_of_two_builds()
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            client.warn_of_two_builds()
