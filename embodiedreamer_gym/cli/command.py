"""The command `embodiedreamer`: parses, calls, prints."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from embodiedreamer_gym.cli.augment import add_augment
from embodiedreamer_gym.cli.demos import add_demos
from embodiedreamer_gym.cli.policy import add_policy
from embodiedreamer_gym.cli.policy_prefer import add_prefer
from embodiedreamer_gym.cli.standin_film import add_film
from embodiedreamer_gym.cli.vis import add_vis
from embodiedreamer_gym.cli.vis_camera import add_camera
from embodiedreamer_gym.demo import run as run_demo
from embodiedreamer_gym.diagnosis import add_effect, compare, diagnose, error_breakdown
from embodiedreamer_gym.diagnosis.report import write_report
from embodiedreamer_gym.effects import CATALOGUE, load_effects
from embodiedreamer_gym.errors import EmbodieDreamerError, RecordingError
from embodiedreamer_gym.io.progress import Progress
from embodiedreamer_gym.io.terminal import count
from embodiedreamer_gym.motions import MOTIONS
from embodiedreamer_gym.phys_aligner import METHODS, calibrate
from embodiedreamer_gym.recordings import Finding, Recording, Recordings, load_recordings, preflight
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.files import write_json

LOG = {
    "rate": ("HZ", "samples per second (default 100)"),
    "seconds": ("S", "of each recording (default 4)"),
    "noise": ("RAD", "sd of the position sensor (default 4e-4)"),
    "quantum": ("RAD", "step of the encoder (default 2 pi / 4096)"),
    "jitter": ("S", "sd of the time stamps (default none)"),
}
MEANINGLESS = ("swapped", "sign-flipped")  # a fit would bend the model to a fault of the log
T = TypeVar("T")


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are errors like any other."""

    def error(self, message: str) -> NoReturn:
        """Raise the complaint as one sentence."""
        raise EmbodieDreamerError(f"{message}; see {self.prog} --help.")


def build_parser() -> argparse.ArgumentParser:
    """Return the command's parser; each verb sets `verb` to the function that does it."""
    parser = Parser(prog="embodiedreamer", description="Hold a robot model against recordings of the robot.")
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    common = Parser(add_help=False)
    common.add_argument("--effects", metavar="FILE.py", help="your own effects; the file is executed")
    common.add_argument("--rate", type=_positive, metavar="HZ", help="of logs without time stamps")
    common.add_argument("--hold", choices=("linear", "hold"), help="how the controller gets to the next command")
    common.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    common.add_argument("--jobs", type=count, default=os.cpu_count() or 1, metavar="N", help="processes")
    common.add_argument("--quiet", action="store_true", help="no progress")
    common.add_argument("--json", type=Path, metavar="FILE", help="write the answer as JSON")
    common.add_argument("--report", type=Path, metavar="DIR", help="write the answer as a page, DIR/index.html")

    def verb(name: str, function: Callable, text: str, out: str | None = None, split: bool = False) -> Any:
        """Add a verb with the options it shares with others."""
        one = verbs.add_parser(name, parents=[common], help=text, description=text)
        one.set_defaults(verb=function)
        one.add_argument("--model", required=True, metavar="M", help="JSON file or built-in robot",
                         action="append" if name == "compare" else "store")  # fmt: skip
        if out:
            one.add_argument("--out", type=Path, required=out == "required", metavar="FILE.json", help="better model")
        for option in ("--train", "--test") if split else ():
            one.add_argument(option, nargs="+", required=True, metavar="REC", help="files, folders, quoted globs")
        if not split:
            one.add_argument("recordings", nargs="+", metavar="REC", help="files, folders, quoted globs")
        return one

    verb("compare", _compare, "error of a model (or several) against the noise floor")
    verb("where", _where, "in which joints and regimes, on which side a model fails")
    fit = verb("calibrate", _calibrate, "fit a model's parameters", out="required")
    fit.add_argument("--method", choices=METHODS, default=METHODS[0], help="default: %(default)s")
    find = verb("diagnose", _diagnose, "calibrate, then find the effects that are missing", out="optional", split=True)
    find.add_argument(
        "--resume", type=Path, metavar="FILE", help="keeps finished fits; goes on where it was interrupted"
    )
    add = verb("add", _add, "add an effect and fit again", out="required", split=True)
    add.add_argument("effect", metavar="EFFECT", help=f"one of {', '.join(CATALOGUE)}, or of --effects")
    _excite_parser(verbs, common)
    _standin_parser(verbs)
    add_camera(add_vis(verbs))
    add_demos(verbs)
    add_augment(verbs)
    add_prefer(add_policy(verbs))
    demo = verbs.add_parser("demo", help="from recordings with a hidden effect to a model that has it")
    demo.set_defaults(verb=_demo)
    demo.add_argument("--out", type=Path, default=Path("demo_report"), metavar="DIR", help="default: %(default)s")
    demo.add_argument("--quiet", action="store_true", help="no progress")
    return parser


def _excite_parser(verbs: Any, common: Parser) -> None:
    """Add the verb that proposes the next motion."""
    text = "the motion that tells two effects apart, safe to run: a csv of commands and a picture of it"
    one = verbs.add_parser("excite", parents=[common], help=text, description=text)
    one.set_defaults(verb=_excite)
    one.add_argument("--model", required=True, metavar="M", help="JSON file or built-in robot")
    one.add_argument("--separate", required=True, metavar="A,B", help="two effects")
    one.add_argument("--out", type=Path, required=True, metavar="FILE.csv", help="commands; FILE.png beside it")
    one.add_argument("recordings", nargs="*", metavar="REC", help="what both effects have to explain so far")
    one.add_argument("--table", type=float, metavar="Z", help="height of a table in the URDF's root frame, m")
    one.add_argument("--seconds", type=_positive, default=8.0, metavar="S", help="of motion (default %(default)s)")
    one.add_argument(
        "--speed", type=_positive, default=0.5, metavar="X", help="share of the speed limits (default %(default)s)"
    )
    one.add_argument("--acceleration", type=_positive, default=6.0, metavar="A", help="rad/s^2 (default %(default)s)")
    one.add_argument(
        "--reach", type=_positive, default=0.6, metavar="R", help="rad to either side (default %(default)s)"
    )


def _standin_parser(verbs: Any) -> None:
    """Add the verb that records a stand-in robot with a hidden effect, or films the tasks."""
    text = (
        "a stand-in for a real robot (MuJoCo) with a hidden effect, or for a real camera, to try things before your own"
    )
    actions = verbs.add_parser("standin", help=text, description=text).add_subparsers(required=True, metavar="ACTION")
    add_film(actions)
    text = "recordings of a stand-in robot with a hidden effect, the truth apart"
    one = actions.add_parser("record", help=text, description=text)
    one.add_argument(
        "--effect", default="none", metavar="E", help="effects, with commas; none, or any (drawn; default %(default)s)"
    )
    one.add_argument("--arm", default="arm6", metavar="ARM", help="arm6, arm6b, arm7 or aloha (default %(default)s)")
    one.add_argument(
        "--side", choices=("left", "right"), default="left", help="of the ALOHA pair (default %(default)s)"
    )
    one.add_argument("--strength", choices=("faint", "plain", "strong"), default="plain", help="default: %(default)s")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    log = one.add_argument_group("the log of a single arm")
    for name, (metavar, text) in LOG.items():
        log.add_argument(f"--{name}", type=_positive, metavar=metavar, help=text)
    log.add_argument("--motion", metavar="KIND", choices=MOTIONS, help=f"of all recordings: {', '.join(MOTIONS)}")
    log.add_argument("--no-command", action="store_true", help="position and effort alone")
    one.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="model.json, train/, test/ and the sealed truth.json"
    )
    one.set_defaults(verb=_standin, quiet=True)


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
        arguments = build_parser().parse_args(argv)
        progress = Progress(arguments.quiet)
        try:
            arguments.verb(arguments, progress)
        finally:
            progress.close()
    except EmbodieDreamerError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return interrupted
    except BrokenPipeError:  # the reader of a pipe has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    finally:
        if before is not None:
            signal.signal(signal.SIGTERM, before)
    return 0


def _compare(a: argparse.Namespace, progress: Progress) -> None:
    _check_outputs(a)
    models = [_model(a, source) for source in a.model]
    found = compare(models, _recordings(a, models[0], a.recordings))
    _answer(a, found, lambda: write_report(a.report, comparison=found))


def _where(a: argparse.Namespace, progress: Progress) -> None:
    _check_outputs(a)
    model = _model(a, a.model)
    found = error_breakdown(model, _recordings(a, model, a.recordings))
    _answer(a, found, lambda: write_report(a.report, breakdown=found))


def _calibrate(a: argparse.Namespace, progress: Progress) -> None:
    _check_outputs(a)
    model = _model(a, a.model)
    recordings = _recordings(a, model, a.recordings, fit=True)
    found = calibrate(model, recordings, a.method, rng=np.random.default_rng(a.seed), progress=progress)
    progress.close()
    labels = ("before", "calibrated")
    _answer(a, found, lambda: write_report(
        a.report, calibration=found, comparison=compare([model, found.model], recordings, labels)
    ))  # fmt: skip
    found.model.save(a.out)


def _diagnose(a: argparse.Namespace, progress: Progress) -> None:
    _check_outputs(a)
    model = _model(a, a.model)
    train, test = (_recordings(a, model, part, fit=True) for part in (a.train, a.test))
    found = diagnose(model, train, test, jobs=a.jobs, seed=a.seed, progress=progress, refit_cache=a.resume)
    progress.close()
    _answer(a, found, lambda: write_report(
        a.report, diagnosis=found, breakdown=error_breakdown(found.calibrated, test), recordings=test
    ))  # fmt: skip
    if a.out:
        found.model.save(a.out)


def _add(a: argparse.Namespace, progress: Progress) -> None:
    _check_outputs(a)
    model = _model(a, a.model)
    richer = model.with_effect(a.effect)  # complains about an unknown effect before any log is read
    train, test = (_recordings(a, richer, part, fit=True) for part in (a.train, a.test))
    found = add_effect(model, a.effect, train, test, progress=progress)
    progress.close()
    _answer(a, found, lambda: write_report(a.report, calibration=found.after, comparison=found.comparison))
    found.after.model.save(a.out)


def _excite(a: argparse.Namespace, progress: Progress) -> None:
    from embodiedreamer_gym.diagnosis.experiment_design import (
        propose_motion,  # PyBullet prints a line when it is loaded
    )
    from embodiedreamer_gym.diagnosis.report.dry_run import dry_run

    _check_outputs(a)
    model = _model(a, a.model)
    pair = tuple(name.strip() for name in a.separate.split(","))
    if len(pair) != 2:
        raise EmbodieDreamerError(f"--separate takes two effects with a comma between them, not '{a.separate}'.")
    logs = _recordings(a, model, a.recordings, fit=True) if a.recordings else ()
    found = propose_motion(
        model, pair, logs, a.seconds, min(a.speed, 1.0), a.acceleration, a.reach, table=a.table,
        seed=a.seed, progress=progress,
    )  # fmt: skip
    progress.close()
    _answer(a, found, lambda: a.report)
    found.save(a.out)
    picture = a.out.with_suffix(".png")
    dry_run(found).savefig(picture, dpi=110)
    print(f"\ncommands: {a.out}\npicture: {picture}; look at it before the robot moves")


def _standin(a: argparse.Namespace, progress: Progress) -> None:
    from embodiedreamer_gym.standin.cases import aloha_case, draw_case

    if a.out.exists() and any(a.out.iterdir() if a.out.is_dir() else [a.out]):
        raise EmbodieDreamerError(f"{a.out} is not empty; give a new folder.")
    rng = np.random.default_rng(a.seed)
    effects = [str(rng.choice(sorted(CATALOGUE)))] if a.effect == "any" else a.effect.split(",")
    effect = None if a.effect == "none" else effects[0] if len(effects) == 1 else effects
    given = {name: getattr(a, name) for name in LOG if getattr(a, name) is not None}
    log: dict[str, Any] = {"hz" if name == "rate" else name: value for name, value in given.items()}
    log |= {"learnt": (a.motion,) * 2, "held_out": (a.motion,) * 2} if a.motion else {}
    log |= {"with_command": False} if a.no_command else {}
    if a.arm == "aloha":
        if log or len(effects) > 1:
            raise EmbodieDreamerError(
                "the ALOHA pair logs teleoperation at 30 Hz with one effect; leave the options out."
            )
        case = aloha_case(effects[0] if effect else None, a.side, rng, a.strength)
    else:
        case = draw_case(effect, a.arm, rng, a.strength, **log)
    part = a.out.with_name(f".{a.out.name}.part")
    model = case.write(part)
    write_json(case.truth, part / "truth.json")
    if a.out.is_dir():
        a.out.rmdir()
    part.rename(a.out)
    rate = " --rate 30" if a.arm == "aloha" else ""
    print(
        f"{len(case.train)} recordings to learn from, {len(case.test)} held out; the truth is in {a.out / 'truth.json'}\n"
    )
    print(
        f"embodiedreamer diagnose --model {a.out / model.name} --train {a.out / 'train'} --test {a.out / 'test'}{rate}"
    )


def _demo(a: argparse.Namespace, progress: Progress) -> None:
    run_demo(a.out, progress)


def _answer(a: argparse.Namespace, found: Any, report: Callable[[], Path], data: dict[str, Any] | None = None) -> None:
    """Print the answer and write what was asked for."""
    print(found)
    if a.report:
        print(f"\nreport: {report()}")
    if a.json:
        write_json(data or found.as_dict(), a.json)


def _model(a: argparse.Namespace, source: str) -> RobotModel:
    catalogue = load_effects(a.effects) if a.effects else CATALOGUE
    return _readable(f"model {source}", lambda: RobotModel.load(source, catalogue))


def _recordings(a: argparse.Namespace, model: RobotModel, patterns: Sequence[str], fit: bool = False) -> Recordings:
    """Load recordings, print what is wrong with them, and leave the bad samples out."""
    load = lambda: load_recordings(*patterns, hz=a.rate, joints=model.joints, command_hold=a.hold)  # noqa: E731
    ends = zip(model.joints, model.tree.lower.tolist(), model.tree.upper.tolist(), strict=True)
    limits = {joint: (low, high) for joint, low, high in ends}
    checked = [preflight(r.with_(units=model.units), limits) for r in _readable("a recording", load)]
    seen: dict[tuple[str, str, tuple[str, ...]], list[tuple[Recording, Finding]]] = {}
    for one in checked:
        for finding in one.findings:
            seen.setdefault((finding.severity, finding.code, finding.joints), []).append((one.recording, finding))
            if fit and finding.code in MEANINGLESS:
                raise RecordingError(f"{one.recording.source or one.recording.name}: {finding.message}.")
    for (severity, *_), found in seen.items():
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        print(f"{severity}: {found[0][0].name}{more}: {found[0][1].message}", file=sys.stderr)
    left_out = sum(sum(one.excluded.values()) for one in checked)
    total = sum(one.recording.position.size for one in checked)
    print(f"{len(checked)} recordings, {left_out} of {total} joint samples left out", file=sys.stderr)
    return Recordings(one.recording for one in checked)


def _readable(what: str, load: Callable[[], T]) -> T:
    """Load a user's file; whatever a library finds wrong with it becomes one sentence."""
    try:
        return load()
    except EmbodieDreamerError:
        raise
    except Exception as error:
        raise EmbodieDreamerError(f"{what} cannot be read: {type(error).__name__}: {error}.") from error


def _check_outputs(a: argparse.Namespace) -> None:
    """Complain about outputs that cannot be written before the long work begins."""
    for path in filter(None, (getattr(a, "out", None), getattr(a, "resume", None), a.json, a.report)):
        parent = path.absolute().parent
        if not parent.is_dir():
            raise EmbodieDreamerError(f"{path} cannot be written: folder {parent} does not exist; make it first.")
        if path.is_dir() != (path == a.report) and path.exists():
            raise EmbodieDreamerError(f"{path} cannot be written: it is {'a folder' if path.is_dir() else 'a file'}.")
        if not os.access(path if path.is_dir() else parent, os.W_OK):
            raise EmbodieDreamerError(f"{path} cannot be written: no permission to write into its folder.")


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < np.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
