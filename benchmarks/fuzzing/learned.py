"""Targets that read episodes, policies, banks, weights and refit caches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzzing.case import Case
from benchmarks.fuzzing.seeds import TRAIN
from benchmarks.fuzzing.targets import mutated, target

# ---- episodes and policies -------------------------------------------------------------------------------------


def _set(case: Case, path: Path) -> None:
    """Open a set of episodes and read it; sometimes train on it."""
    from embodiedreamer_gym.recordings.episodes import open_episodes

    def read() -> None:
        episodes = open_episodes(path)
        for k in range(len(episodes)):
            episodes.states(k), episodes.actions(k)
            for camera in episodes.cameras:
                episodes.frames(k, camera, 0, min(3, episodes.lengths[k]))

    case.library("open_episodes", read)
    if case.number % 3 == 0:
        case.command("policy", "train", "--data", path, "--out", case.out / "policy", *TRAIN)


@target
def episodes(case: Case) -> None:
    name = case.rng.choice(("episodes", "episodes", "jpegs"))
    path = mutated(case, name)
    _set(case, path)
    if case.number % 3 == 1:
        case.command("augment", "--data", path, "--out", case.out / "more", "--aligner", case.copy("lean.pt"), "--task", "PutCupOnMat-v0",
                     "--quiet", patience=1.0)  # fmt: skip


@target
def lerobot(case: Case) -> None:
    _set(case, mutated(case, "lerobot_set"))


def _policy(case: Case, name: str) -> None:
    from embodiedreamer_gym.policies import load_policy
    from embodiedreamer_gym.policies.protocol import picture_inputs

    path = mutated(case, name)

    def ask() -> None:
        policy: Any = load_policy(path)
        cameras, size = picture_inputs(policy)
        frame = np.zeros((1, *(size or (16, 12))[::-1], 3), np.uint8)
        joints = policy.network.config.state_size if hasattr(policy, "network") else policy.action_size
        policy({"agent_pos": np.zeros((1, joints), np.float32), "pixels": dict.fromkeys(cameras, frame)})

    case.library("load_policy", ask)
    if case.number % 2 == 0:
        case.names.clear()  # an intact policy that does not fit the robot is refused because of its sizes
        case.command(
            "policy",
            "evaluate",
            "--policy",
            path,
            "--task",
            "PutCupOnMat-v0",
            "--episodes",
            1,
            "--json",
            case.out / "e.json",
            "--quiet",
        )


@target
def policy(case: Case) -> None:
    _policy(case, "policy")


@target
def lerobot_policy(case: Case) -> None:
    _policy(case, "lerobot_policy")


@target
def key_poses(case: Case) -> None:
    _policy(case, "key_poses")


@target
def preferences(case: Case) -> None:
    """Pairs of rollouts."""
    from embodiedreamer_gym.policies.preferences import PreferenceSet

    path = mutated(case, "pairs.hdf5")
    case.library("PreferenceSet.load", lambda: PreferenceSet.load(path).save(case.out / "again.hdf5"))


@target
def resume(case: Case) -> None:
    """A training folder, whose training is to resume from its checkpoint."""
    case.copy("episodes")
    path = case.copy("training")
    name = case.rng.choice(("checkpoint.pt", "checkpoint.pt", "checkpoint.pt", "curves.csv", "config.json"))
    case.about(case.mutate(path / name), path)
    case.command("policy", "train", "--data", "episodes", "--out", path, *TRAIN)


@target
def module(case: Case) -> None:
    """A module with a faulty user-defined policy."""
    from benchmarks.fuzzing.modules import source
    from embodiedreamer_gym.policies import load_policy
    from embodiedreamer_gym.policies.protocol import predict

    Path("mine.py").write_text(source(case.rng), encoding="utf-8")
    name = case.rng.choice(
        ("mine:make",) * 12
        + (
            "mine:none",
            "mine",
            "none:make",
            "mine:make:x",
            "mine:",
            ":make",
            "..mine:make",
            "a b:c",
            "mine:chunk",
            "os:getcwd",
        )
    )
    batch = {"agent_pos": np.zeros((1, 14), np.float32), "pixels": {"head": np.zeros((1, 12, 16, 3), np.uint8)}}
    case.library("load_policy", lambda: predict(load_policy(name), batch, (1, 4, 14)))
    case.command(
        "policy",
        "evaluate",
        "--policy",
        name,
        "--task",
        "PutCupOnMat-v0",
        "--episodes",
        1,
        "--quiet",
        "--json",
        case.out / "e.json",
    )


# ---- the video model -------------------------------------------------------------------------------------------


@target
def bank(case: Case) -> None:
    from embodiedreamer_gym.vis_aligner import load_bank, load_episode

    name, shown = case.rng.choice((("bank.npz", "film.hdf5"), ("lit_bank.npz", "shaded.hdf5")))
    path = mutated(case, name)
    film = case.copy(shown)
    case.about(film)

    def read() -> None:
        known, condition = load_bank(path), load_episode(film).condition
        known.compose(condition)
        if known.bench is not None and known.bench.light is not None:
            known.bench.light.on(condition)

    case.library("load_bank", read)
    if case.number % 4 == 0:
        case.command(
            "vis", "render", film, "--aligner", case.copy("lean.pt"), "--bank", path, "--out", case.out / "film.mp4"
        )


@target
def weights(case: Case) -> None:
    from embodiedreamer_gym.vis_aligner import load_aligner

    path = mutated(case, "lean.pt")
    case.library("load_aligner", lambda: load_aligner(path))
    if case.number % 2 == 0:
        case.command("vis", "render", case.copy("film.hdf5"), "--aligner", path, "--out", case.out / "film.mp4")


@target
def svd(case: Case) -> None:
    """A folder with a diffusers model; does nothing if diffusers is not installed."""
    from embodiedreamer_gym.vis_aligner import load_aligner

    if not (case.seeds / "svd").is_dir():
        return
    path = mutated(case, "svd")
    case.library("load_aligner", lambda: load_aligner(path, steps=1))
    if case.number % 4 == 0:
        case.command("vis", "render", case.copy("film.hdf5"), "--aligner", path, "--out", case.out / "film.mp4")


@target
def film(case: Case) -> None:
    """An episode with its simulated view."""
    from embodiedreamer_gym.vis_aligner import load_episode

    path = mutated(case, case.rng.choice(("film.hdf5", "shaded.hdf5")))
    case.library("load_episode", lambda: load_episode(path))
    other = case.rng.choice((("vis", "render", path, "--aligner", case.copy("lean.pt"), "--out", case.out / "f.mp4"),
                             ("vis", "bank", path, "--out", case.out / "b.npz")))  # fmt: skip
    case.command(*other)


# ---- benchmark and diagnosis -------------------------------------------------------------------------------------------------


@target
def refits(case: Case) -> None:
    """The file in which a diagnosis keeps its finished refits."""
    from benchmarks.fuzzing.refits import read_refits, write_refits

    case.copy("two.urdf")
    arm, log = case.copy("two.json"), case.copy("log.csv")
    path = case.folder / "refits.jsonl"
    write_refits(path, arm, log)
    case.about(case.mutate(path))
    case.library("refit cache", lambda: read_refits(path, arm, log))
    case.command(
        "diagnose",
        "--model",
        arm,
        "--train",
        log,
        "--test",
        case.copy("test.csv"),
        "--resume",
        path,
        "--jobs",
        1,
        "--quiet",
        patience=1.5,
    )


@target
def bench_answers(case: Case) -> None:
    """Answers to benchmark cases with predictions: score them, and resume a run after them."""
    case.copy("truth"), case.copy("cases")
    path = mutated(case, "answers")
    answers = path / "a.jsonl"
    case.command("bench", "score", "--truth", "truth", "--answers", answers, "--json", case.out / "s.json", "--quiet")
    case.command("bench", "run", "coulomb", "--cases", "cases", "--out", answers, "--jobs", 1, "--quiet")


@target
def bench_cases(case: Case) -> None:
    """Cases of the benchmark, or their ground truth."""
    name = case.rng.choice(("cases", "truth"))
    case.copy("answers"), case.copy({"cases": "truth", "truth": "cases"}[name])
    mutated(case, name)
    case.command("bench", "score", "--truth", "truth", "--answers", "answers/a.jsonl", "--quiet")
    case.command(
        "bench", "run", "coulomb", "--cases", "cases", "--out", case.folder / "in.jsonl", "--jobs", 1, "--quiet"
    )
