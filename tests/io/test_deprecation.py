"""Old names and arguments give what the new ones give, and warn."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import pytest

from embodiedreamer_gym.io.deprecation import deprecated_names, renamed_arguments

new = object()


def test_an_old_name_is_the_new_one() -> None:
    names = {"old": "new", "folder": "os.path", "joined": "os.path:join"}
    get = deprecated_names(__name__, names)
    with pytest.warns(DeprecationWarning, match=r"test_deprecation\.old is now new"):
        assert get("old") is new
    with pytest.warns(DeprecationWarning, match=r"now os\.path\.join"):
        assert get("joined") is sys.modules["os.path"].join
    with pytest.warns(DeprecationWarning):
        assert get("folder") is sys.modules["os.path"]
    with pytest.raises(AttributeError, match="has no attribute 'other'"):
        get("other")


def test_an_old_argument_is_the_new_one() -> None:
    @renamed_arguments(rate="hz")
    def wait(hz: float) -> float:
        return hz

    @renamed_arguments(rate="hz")
    @dataclass(frozen=True)
    class Settings:
        hz: float = 1.0

    assert wait(hz=2.0) == 2.0 and Settings(3.0).hz == 3.0
    with pytest.warns(DeprecationWarning, match="argument 'rate' of .*wait is now 'hz'"):
        assert wait(rate=2.0) == 2.0
    with pytest.warns(DeprecationWarning, match="Settings is now 'hz'"):
        assert Settings(rate=4.0) == Settings(4.0)
