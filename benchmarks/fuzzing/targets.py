"""Targets that read recordings, models, URDFs and cameras: each calls the library and the command."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzzing.case import Case

TARGETS: dict[str, Callable[[Case], None]] = {}


def target(run: Callable[[Case], None]) -> Callable[[Case], None]:
    """Register a target under its function's name."""
    TARGETS[run.__name__] = run
    return run


def mutated(case: Case, name: str) -> Path:
    """A mutated copy of a seed."""
    path = case.copy(name)
    case.about(case.mutate(path), path)
    return path


# ---- recordings ------------------------------------------------------------------------------------------------


def _log(case: Case, path: Path, units: str | None = None) -> None:
    """Load a log, check it, and compare a model with it; units: units of a LeRobot set."""
    from embodiedreamer_gym.recordings import load_recordings, preflight

    def read() -> None:
        for one in load_recordings(path, hz=100.0, units=units):
            preflight(one)
            for frames in one.frames.values():
                frames[0], frames[len(frames) - 1]

    case.library("load_recordings", read)
    case.copy("two.urdf")
    model = case.copy("two.json")
    verb = "compare" if case.number % 4 else case.rng.choice(("where", "calibrate"))
    out = ("--out", case.out / "better.json") if verb == "calibrate" else ()
    out += () if units is None else ("--units", units)
    case.command(verb, "--model", model, path, "--jobs", 1, "--quiet", "--json", case.out / "answer.json", *out)


@target
def csv(case: Case) -> None:
    _log(case, mutated(case, "log.csv"))


@target
def hdf5(case: Case) -> None:
    _log(case, mutated(case, "log.hdf5"))


@target
def sage(case: Case) -> None:
    _log(case, mutated(case, "sage"))


@target
def lerobot_log(case: Case) -> None:
    path = case.copy("lerobot_log")
    case.about(case.mutate(path), path)
    _log(case, path, "rad")


@target
def mcap(case: Case) -> None:
    _log(case, mutated(case, "log.mcap"))


@target
def rosbag2(case: Case) -> None:
    _log(case, mutated(case, case.rng.choice(("bag", "bag_mcap"))))


@target
def motor_calibration(case: Case) -> None:
    from embodiedreamer_gym.recordings.motor_units import read_motor_calibration

    path = mutated(case, "motors.json")
    case.library("read_motor_calibration", lambda: read_motor_calibration(path))


@target
def trajectory(case: Case) -> None:
    """Commands or a log for a model to follow, and commands for an arm to play."""
    from embodiedreamer_gym.robot import RobotModel
    from embodiedreamer_gym.robot.play import SafeMotion

    case.copy("two.urdf")
    arm = case.copy("two.json")
    path = mutated(case, case.rng.choice(("commands.csv", "commands.csv", "log.csv")))
    case.library("SafeMotion.load", lambda: SafeMotion.load(path, RobotModel.load(arm), speed=50.0))
    case.command(
        "track", path, "--model", arm, "--out", case.out / "sent.csv", "--json", case.out / "e.json", "--quiet"
    )


@target
def marks(case: Case) -> None:
    """Points marked in frames."""
    case.copy("two.urdf")
    log, path = case.copy("log.hdf5"), mutated(case, "marks.json")
    case.command("vis", "camera", "--model", "two.urdf", "--joints", "shoulder,elbow", log, "--marks", path,
                 "--out", case.out / "camera.json", "--quiet", patience=1.5)  # fmt: skip


@target
def effects_file(case: Case) -> None:
    """A user's effect, which is executed."""
    from embodiedreamer_gym.effects import load_effects

    case.copy("two.urdf")
    path, arm, log = mutated(case, "hose_spring.py"), case.copy("two.json"), case.copy("log.csv")
    case.library("load_effects", lambda: load_effects(path))
    if case.number % 4 == 0:
        case.command("add", "hose_spring", "--effects", path, "--model", arm, "--train", log, "--test", case.copy("test.csv"), "--jobs", 1,
                     "--out", case.out / "m.json", "--quiet")  # fmt: skip


# ---- models, URDFs, cameras ------------------------------------------------------------------------------------


def _model(case: Case, name: str) -> None:
    from embodiedreamer_gym.robot import RobotModel

    case.copy("log.csv")
    for other in {"two.urdf", "two.json"} - {name}:
        case.copy(other)
    mutated(case, name)
    case.about(Path("two.json"), Path("two.urdf"))

    def read() -> None:
        model = RobotModel.load("two.json")
        list(model.parameters())
        model.save(case.out / "again.json")
        RobotModel.load(case.out / "again.json")

    case.library("RobotModel.load", read)
    case.command("compare", "--model", "two.json", "log.csv", "--jobs", 1, "--quiet")


@target
def model(case: Case) -> None:
    _model(case, "two.json")


@target
def urdf(case: Case) -> None:
    from embodiedreamer_gym.robot.forward_kinematics import EndEffector
    from embodiedreamer_gym.robot.surface import Surface

    _model(case, "two.urdf")
    case.library("Surface", lambda: Surface("two.urdf", ("shoulder", "elbow")).points(np.zeros((2, 2))))
    case.library("EndEffector", lambda: EndEffector("two.urdf", "tip").pose(np.zeros((2, 2)), ("shoulder", "elbow")))
    out = ("--out", case.out / "camera.json", "--quiet")
    case.names.clear()  # even an intact robot is not recognised in these pictures
    case.command(
        "vis", "camera", "--model", "two.urdf", "--joints", "shoulder,elbow", case.copy("log.hdf5"), *out, patience=1.5
    )


@target
def cameras(case: Case) -> None:
    from embodiedreamer_gym.envs.aloha import AlohaEnv
    from embodiedreamer_gym.envs.cameras import load_cameras, save_cameras

    path = mutated(case, "cameras.json")
    read: dict[str, Any] = {}
    good = case.library("load_cameras", lambda: read.update(load_cameras(path)))
    if good:
        case.library("save_cameras", lambda: save_cameras(read, case.out / "again.json"))
        case.names.clear()

        def draw() -> None:
            env = AlohaEnv(camera_file=str(path), cameras=next(iter(read)), renderer="tiny", image_size=(16, 12))
            env.reset(seed=0)
            env.close()

        if case.number % 4 == 0:
            case.library("AlohaEnv(camera_file)", draw)
        case.about(path, *map(Path, read))
    log = ("--model", "two.json", "--episodes", case.copy("log.hdf5"), "--out", case.out / "films", "--quiet")
    case.copy("two.json"), case.copy("two.urdf")
    case.command("vis", "prepare", "--cameras", path, "--camera", "head", "--size", "16x12", *_prepare(log))


def _prepare(log: tuple[Any, ...]) -> list[Any]:
    """Options for `vis prepare`, which takes the episodes as positional arguments."""
    rest = list(log)
    at = rest.index("--episodes")
    return [rest[at + 1], *rest[:at], *rest[at + 2 :]]
