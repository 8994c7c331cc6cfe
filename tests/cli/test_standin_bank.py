"""The verb `standin bank`: a bank of another size in one command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.pipelines.prepare import write_episode
from embodiedreamer_gym.standin.film import run as films
from embodiedreamer_gym.vis_aligner import load_bank
from tests.vis_aligner.scenes import HEIGHT, WIDTH, episode


def test_the_bench_is_filmed_and_its_bank_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    asked = []

    def film(settings, count, folder, *_: object) -> None:
        asked.extend((one.task, one.size, one.seed, count) for one in settings)
        folder.mkdir()
        for seed in range(count):
            write_episode(episode(seed), folder / f"{seed}.hdf5")

    monkeypatch.setattr(films, "film_episodes", film)
    command = ["standin", "bank", "--size", f"{WIDTH}x{HEIGHT}", "--episodes", "2", "--seed", "5", "--out"]
    assert main([*command, str(tmp_path / "bench.npz"), "--quiet"]) == 0
    assert asked == [(task, (WIDTH, HEIGHT), 5, 2) for task in TASKS]
    assert load_bank(tmp_path / "bench.npz").size == (WIDTH, HEIGHT)
    assert "2 photos" in capsys.readouterr().out and (tmp_path / "bench_films").is_dir()
    assert main([*command, str(tmp_path / "b.npz"), "--photo-scale", "1", "--appearance", "many"]) == 2
    assert "a bank shows one bench" in capsys.readouterr().err


def test_larger_photos_are_filmed_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder of their own, from the same seed, by the head camera alone."""
    asked = []

    def film(settings, count, folder, *_: object) -> None:
        asked.append((folder.name, settings[0].size, settings[0].seed, settings[0].cameras))
        folder.mkdir()
        one = episode(0)
        grown = replace(one.condition, **{name: getattr(one.condition, name).repeat(2, 1).repeat(2, 2)
                                          for name in ("rgb", "classes", "depth", "parts")
                                          if getattr(one.condition, name) is not None})  # fmt: skip
        larger = replace(one, frames=one.frames.repeat(2, 1).repeat(2, 2), condition=grown)
        write_episode(one if settings[0].size == (WIDTH, HEIGHT) else larger, folder / "0.hdf5")

    monkeypatch.setattr(films, "film_episodes", film)
    command = ["standin", "bank", "--size", f"{WIDTH}x{HEIGHT}", "--episodes", "1", "--photo-scale", "2", "--quiet"]
    assert main([*command, "--out", str(tmp_path / "bench.npz")]) == 0
    assert asked == [
        ("bench_films", (WIDTH, HEIGHT), 0, ("head",)),
        ("bench_films_2x", (2 * WIDTH, 2 * HEIGHT), 0, ("head",)),
    ]
    assert load_bank(tmp_path / "bench.npz").size == (WIDTH, HEIGHT)
