"""Options of settings dataclasses: name, default, help, type and range of each field."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest

from embodiedreamer_gym.cli import options as o


@dataclass(frozen=True)
class Settings:
    task: str
    """Name of
    the task."""
    count: int = 3
    """How many."""
    chunk_size: int | None = None
    """Actions."""
    share: Annotated[float, (0.0, 1.0, True)] = 0.5
    """Of all."""
    kind: Literal["one", "two"] = "one"
    """Either."""
    seed: int = 0
    """Of the random numbers."""
    folder: Path | None = None
    """To write."""


def parse(*words: str) -> Settings:
    parser = argparse.ArgumentParser(exit_on_error=False)
    for flag, given in o.settings_options(Settings, folder={"kind": o.output_folder}):
        parser.add_argument(flag, **given)
    return o.settings_of(Settings, parser.parse_args(words))


def test_options_have_the_defaults_types_and_texts_of_the_fields() -> None:
    assert parse("--task", "t") == Settings("t")
    words = ("--count", "4", "--chunk-size", "5", "--share", "1", "--kind", "two", "--seed", "0", "--folder", "f")
    assert parse("--task", "t", *words) == Settings("t", 4, 5, 1.0, "two", 0, Path("f"))
    given = {one.name: one.settings for one in o.settings_options(Settings)}
    assert given["--task"]["required"] and given["--task"]["help"] == "Name of the task"
    assert given["--count"]["help"] == "How many (default: %(default)s)" and given["--chunk-size"]["help"] == "Actions"


@pytest.mark.parametrize(
    "words",
    [("--count", "0"), ("--count", "1.5"), ("--share", "0"), ("--share", "1.1"), ("--seed", "-1"), ("--kind", "x")],
)
def test_values_outside_the_range_are_refused(words: tuple[str, str]) -> None:
    with pytest.raises(argparse.ArgumentError, match=words[1]):
        parse("--task", "t", *words)


def test_every_field_of_a_verbs_settings_has_a_text() -> None:
    from embodiedreamer_gym.pipelines import settings

    for kind in (settings.EvaluationSettings, settings.StudySettings):
        assert all(one.settings["help"] for one in o.settings_options(kind))
