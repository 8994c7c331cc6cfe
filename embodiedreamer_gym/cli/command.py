"""The command `embodiedreamer`: finds the verb, parses its options, runs it, and turns errors into one sentence."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any, NoReturn

from embodiedreamer_gym.cli import (
    add,
    augment,
    breakdown,
    calibrate,
    compare,
    demo,
    demos,
    diagnose,
    effects,
    excite,
    policy_evaluate,
    policy_prefer,
    policy_train,
    robots,
    standin_film,
    standin_record,
    vis,
    vis_camera,
    vis_prepare,
)  # fmt: skip
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.progress import Progress

POLICY = {"train": policy_train, "evaluate": policy_evaluate, "prefer": policy_prefer}
STANDIN = {"record": standin_record, "film": standin_film}
VIS = {"train": vis.TRAIN, "fine-tune": vis.FINE_TUNE, "evaluate": vis.EVALUATE, "render": vis.RENDER,
       "bank": vis.MAKE_BANK, "prepare": vis_prepare, "camera": vis_camera}  # fmt: skip
VERBS: dict[str, Any] = {
    "compare": compare, "breakdown": breakdown, "calibrate": calibrate, "diagnose": diagnose, "add": add,
    "excite": excite, "effects": effects, "robots": robots, "demo": demo,
    "standin": (STANDIN, "a stand-in for a real robot (MuJoCo) with a hidden effect, or for a real camera"),
    "demos": demos,
    "policy": (POLICY, "policies: trained on demonstrations, judged in the environments"),
    "vis": (VIS, "the video model that turns simulated frames into realistic ones"),
    "augment": augment,
}  # fmt: skip
HZ = {"--rate": "--hz"}
LEARNING_RATE = {"--rate": "--learning-rate"}
VIS_ALIGNER = {"--dream": "--vis-aligner"}
RENAMED = {  # of a verb, or of a verb's action: old option -> new option, for one release
    **dict.fromkeys(["compare", "breakdown", "calibrate", "diagnose", "add", "excite", "standin record"], HZ),
    "vis camera": HZ, "standin film": {"--look": "--appearance"}, "policy train": LEARNING_RATE,
    "policy evaluate": VIS_ALIGNER, "policy prefer": LEARNING_RATE | VIS_ALIGNER,
}  # fmt: skip
QUICK = ("effects", "robots")  # verbs without progress


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are errors like any other."""

    def error(self, message: str) -> NoReturn:
        """Raise the complaint as one sentence."""
        raise EmbodieDreamerError(f"{message}; see {self.prog} --help.")


def build_parser() -> argparse.ArgumentParser:
    """Return the command's parser; each verb sets `run` to the function that does it."""
    parser = Parser(
        prog="embodiedreamer", description="Compare, calibrate and diagnose a robot model with logs of the robot."
    )
    parser.add_argument("--version", action="version", version=f"embodiedreamer {version('embodiedreamer-gym')}")
    _add_verbs(parser, VERBS, "VERB")
    return parser


def _add_verbs(parser: argparse.ArgumentParser, verbs: Mapping[str, Any], metavar: str) -> None:
    choices = parser.add_subparsers(required=True, metavar=metavar)
    for name, verb in verbs.items():
        text = verb[1] if isinstance(verb, tuple) else verb.TEXT
        one = choices.add_parser(name, help=text, description=text)
        if isinstance(verb, tuple):
            _add_verbs(one, verb[0], "ACTION")
            continue
        for flag, settings in verb.OPTIONS:
            one.add_argument(flag, **settings)
        one.set_defaults(run=verb.run, quiet=name in QUICK)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns 0, 2 after a user's mistake, 130 when interrupted, 143 when terminated."""
    interrupted = 130

    def terminate(number: int, frame: Any) -> NoReturn:
        """End as Ctrl-C does, which ends the processes beside this one too."""
        nonlocal interrupted
        interrupted = 128 + number
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, terminate) if threading.current_thread() is threading.main_thread() else None
    try:
        execute(sys.argv[1:] if argv is None else argv)
    except EmbodieDreamerError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, SystemError) as error:
        if isinstance(error, SystemError) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise  # else: an interrupt inside compiled code
        print("interrupted", file=sys.stderr)
        return interrupted
    except BrokenPipeError:  # the reader of a pipe has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (
        OSError
    ) as error:  # a file of the user's that no verb has checked: too long a name, no permission, a full disk
        print(f"error: {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        return 2
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)
    return 0


def execute(argv: Sequence[str]) -> None:
    """Parse the options and run the verb.

    Raises: EmbodieDreamerError in one sentence for whatever the user can mend.
    """
    options = build_parser().parse_args(renamed(list(argv)))
    progress = Progress(options.quiet)
    progress.starting(" ".join(word for word in argv[:2] if not word.startswith("-")))
    try:
        options.run(options, progress)
    finally:
        progress.close()


def renamed(argv: list[str]) -> list[str]:
    """The arguments with the present names of verbs and options; prints a warning for each former one."""
    changed = argv[:]
    if argv[:1] == ["where"]:
        changed[0] = "breakdown"
    verb = next((name for name in (changed[0], " ".join(changed[:2])) if name in RENAMED), "") if changed else ""
    for i, word in enumerate(changed):
        name, equals, value = word.partition("=")
        if name in RENAMED.get(verb, {}):
            changed[i] = RENAMED[verb][name] + equals + value
    for old, new in dict.fromkeys(zip(argv, changed, strict=True)):
        if old != new:
            old, new = old.partition("=")[0], new.partition("=")[0]
            print(f"warning: {old} is now {new}; the old name works for one more release", file=sys.stderr)
    return changed
