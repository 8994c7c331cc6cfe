"""Messages of errors stay short, whatever a user's file holds."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from embodiedreamer_gym.errors import MOST, MissingExtraError, RecordingError
from embodiedreamer_gym.recordings import Recording


@pytest.mark.parametrize("kind", [RecordingError, MissingExtraError])
def test_a_long_message_keeps_its_beginning_and_end(kind: type[Exception]) -> None:
    error = kind("log.csv: " + 9999 * "a" + "; give another name")
    assert str(error).startswith("log.csv: aaa") and str(error).endswith("aaa; give another name")
    assert len(str(error)) < MOST and str(copy.copy(error)) == str(error)
    assert str(kind("log.csv: short")) == "log.csv: short"
    assert str(kind("log.csv: joint '\n' is missing")) == "log.csv: joint ' ' is missing"


def test_a_long_value_of_a_log_is_not_quoted_whole() -> None:
    with pytest.raises(RecordingError, match="command_hold 'aaa") as caught:
        Recording("log", ("a",), np.arange(10.0), np.zeros((10, 1)), command_hold=9999 * "a")
    assert len(str(caught.value)) < MOST
