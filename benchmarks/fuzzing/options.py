"""Command lines: every verb with invalid options."""

from __future__ import annotations

import functools
import io
import re
from contextlib import redirect_stderr, redirect_stdout, suppress
from random import Random

from benchmarks.fuzzing.case import Case

SEEDS = (
    "two.json",
    "two.urdf",
    "log.csv",
    "test.csv",
    "log.hdf5",
    "episodes",
    "policy",
    "lean.pt",
    "bank.npz",
    "film.hdf5",
    "cameras.json",
    "commands.csv",
    "cases",
    "truth",
    "answers",
)
TASK = ("--task", "PutCupOnMat-v0")
ARM = ("--model", "two.json")
QUIET = "--quiet"
VERBS: dict[str, tuple[str, ...]] = {  # verb -> a valid command line
    "compare": (*ARM, "log.csv", QUIET), "where": (*ARM, "log.csv", QUIET), "calibrate": (*ARM, "log.csv", "--out", "out/m.json"),
    "diagnose": (*ARM, "--train", "log.csv", "--test", "test.csv", "--jobs", "1"),
    "add": ("backlash", *ARM, "--train", "log.csv", "--test", "test.csv", "--out", "out/m.json"),
    "sessions": ("log.csv", "./log.csv", *ARM, "--effect", "payload"),
    "excite": (*ARM, "--separate", "backlash,coulomb_friction", "--out", "out/m.csv"),
    "export": (*ARM, "--to", "mjcf", "--out", "out/m.xml"),
    "standin record": ("--effect", "backlash", "--seconds", "1", "--out", "out/s"),
    "bench make": ("--cases", "1", "--seconds", "1", "--out", "out/b"), "bench run": ("coulomb", "--cases", "cases", "--out", "out/a.jsonl"),
    "bench score": ("--truth", "truth", "--answers", "answers/a.jsonl"),
    "track": ("commands.csv", *ARM, "--out", "out/m.csv"), "workbench": ("log.csv", *ARM, "--no-browser", "--out", "out/m.json"),
    "standin bank": ("--out", "out/b.npz", "--episodes", "1", "--size", "16x12", "--samples", "1", "--films", "out/f"),
    "effects": (), "robots": (),
    "standin film": (*TASK, "--out", "out/f", "--frames", "2", "--size", "16x12", "--samples", "1"),
    "demos": (*TASK, "--episodes", "1", "--out", "out/d", "--jobs", "1", "--size", "16x12"),
    "augment": ("--data", "episodes", "--out", "out/a", "--aligner", "lean.pt"),
    "policy train": ("--data", "episodes", "--out", "out/p", "--steps", "1", "--batch", "1", "--chunk", "2", "--size", "16x12"),
    "policy evaluate": ("--policy", "policy", *TASK, "--episodes", "1", QUIET),
    "policy prefer": ("--policy", "policy", *TASK, "--out", "out/q", "--cycles", "1", "--starts", "1", "--evaluations", "1"),
    "vis train": ("film.hdf5", "--out", "out/v", "--steps", "1"), "vis fine-tune": ("film.hdf5", "--aligner", "lean.pt", "--out", "out/v", "--steps", "1"),
    "vis evaluate": ("film.hdf5", "--aligner", "lean.pt"), "vis render": ("film.hdf5", "--aligner", "lean.pt", "--out", "out/f.mp4"),
    "vis bank": ("film.hdf5", "--out", "out/b.npz"), "vis prepare": ("log.hdf5", *ARM, "--out", "out/e", "--size", "16x12"),
    "vis camera": ("log.hdf5", *ARM, "--out", "out/c.json"), "demo": ("--out", "out/report"),
}  # fmt: skip
RUBBISH = (
    "", " ", "0", "-1", "1", "-1e9", "nan", "inf", "-inf", "1e308", "1e-320", "1" + "0" * 400, "9" * 5000, "0.5", "1e400", "x", "é", "\U0001f916", "none", "None", "null", "true",
    "../..", "/", ".", "~", "out", "log.csv", "none.json", "/dev/null", "/dev/full", "two.urdf", "out/../log.csv", "no/such/folder/x.json", "a" * 300, "a" * 5000, "*", "[", "**/*",
    "?", "%s", "{0}", "-", "--", "---", "@two.json", "=", "a=b", "a,b", ",", ",,", "a:b", ":", "mine:make", "0x0", "1x1", "-1x5", "99999x99999", "16x12", "1e3x2", "12x", "linear", "hold", "backlash",
    "all", "any", "head", "head,head", "lean", "lab", "cpu", "cuda", "small", "paper", "PutCupOnMat-v0", "PutCupOnMat", "Fly-v0", "aloha", "so101", "two.json", "film.hdf5", "1,2", "(1, 2)", "1_000", "٣", "1\n2", "\udcff",
)  # fmt: skip


@functools.cache
def offered(verb: str) -> tuple[str, ...]:
    """The options listed in a verb's help."""
    from embodiedreamer_gym.cli import main

    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said), suppress(SystemExit):
        main([*verb.split(), "--help"])
    found = sorted(set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", said.getvalue())) - {"--help"})
    return tuple(found) or ("--quiet",)


def command_line(verb: str, rng: Random) -> list[str]:
    """A verb's command line with some options changed, left out, repeated or unknown."""
    words = list(VERBS[verb])
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        kind = rng.randrange(10)
        at = rng.randrange(len(words) + 1)
        if kind < 5:
            words += [rng.choice(offered(verb)), *([rng.choice(RUBBISH)] if kind else [])]
        elif kind == 5:
            words += [f"{rng.choice(offered(verb))}={rng.choice(RUBBISH)}"]
        elif kind == 6:
            words[at:] = words[at + 1 :]
        elif kind == 7:
            words[at : at + 1] = [rng.choice(RUBBISH)]
        elif kind == 8:
            words.insert(at, rng.choice(("--none", "-q", "--", "-", "--help", "-h", "--version", "--out", *RUBBISH)))
        else:
            words = rng.sample(words, len(words))
    return [*([] if rng.random() < 0.01 else verb.split()), *words]


def options(case: Case) -> None:
    """Run a verb with some invalid options."""
    for name in SEEDS:
        case.copy(name)
    verb = sorted(VERBS)[case.number % len(VERBS)]
    case.command(*command_line(verb, case.rng), patience=1.0)
