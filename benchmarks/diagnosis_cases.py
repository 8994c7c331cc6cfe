"""Cases of the diagnosis benchmark: their labels, the robots, and one diagnosis of each.

A label states which effects a robot hides and their strength; everything else about the robot, its motions and its
noise comes from the case's own generator, `default_rng([seed, number of the set, index])`. The diagnoser gets only the
files that a user would have; its answer is compared with the label afterwards.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.independent import cases as independent
from benchmarks.independent.arms import ARMS
from benchmarks.independent.outside import OUTSIDE as INDEPENDENT_OUTSIDE
from embodiedreamer_gym.diagnosis import Diagnosis, add_effect, compare, diagnose
from embodiedreamer_gym.diagnosis.candidates import refit, single_trial
from embodiedreamer_gym.diagnosis.decision import decide
from embodiedreamer_gym.diagnosis.experiment_design import propose_motion
from embodiedreamer_gym.diagnosis.screening import linearise, screen
from embodiedreamer_gym.effects import CATALOGUE
from embodiedreamer_gym.motions import Motion
from embodiedreamer_gym.phys_aligner.calibration import finish, fit_least_squares
from embodiedreamer_gym.recordings import load_recordings, save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.standin.cases import Case
from embodiedreamer_gym.standin.effect_sizes import FIRMWARE
from embodiedreamer_gym.standin.labels import (
    AS_A_PERSON,
    BARELY,
    IN_EFFORT,
    OUTSIDE,
    PLAIN,
    SINGLES,
    STRONG,
    draw_at_rest,
    draw_strength,
    partners,
    places,
)

SEEDS = {
    "development": 20011,
    "test": 70001,
    "sealed": 16249039,
    "sealed_2": 12938146,
    "sealed_3": 5007506,
    "sealed_4": 8504937,
    "sealed_5": 2024625,
    "sealed_6": 6010311,
    "sealed_7": 8252670,
    "sealed_8": 9859207,
    "sealed_9": 2472138,
    "sealed_10": 5971997,
    "sealed_11": 8950964,
    "sealed_12": 6585362,
}
# With URDF errors, an effort offset per joint is estimated; it absorbs a bias, also of direction-dependent friction.
BESIDE_OFFSETS = tuple(name for name in IN_EFFORT if name not in ("torque_bias", "direction_dependent_friction"))
PLAIN_NOISES = 10.0  # visibility above which an effect of the independent generator is plain
TIES = (
    ("command_delay", "command_lowpass"),
    ("torque_bias", "joint_spring"),
    ("payload", "base_tilt"),
    ("coulomb_friction", "stribeck_friction"),
    ("backlash", "joint_elasticity"),
    ("encoder_offset", "torque_bias"),
    ("load_friction", "direction_dependent_friction"),
    ("servo_deadzone", "backlash"),
)


@dataclass(frozen=True)
class Design:
    """A set of cases: counts by kind, effects used in rotation, arms, recording settings, strengths of singles.

    independent: whether `benchmarks.independent` makes the cases; strengths are then visibilities in sensor noises.
    """

    number: int
    counts: Mapping[str, int]
    singles: tuple[str, ...] = SINGLES
    arms: tuple[str, ...] = ("arm6",)
    recording: Mapping[str, Any] = field(default_factory=dict)
    strengths: tuple[float, float] = (BARELY, STRONG)
    independent: bool = False

    @property
    def outside(self) -> tuple[str, ...]:
        """Effects that the diagnoser's catalogue lacks."""
        return tuple(INDEPENDENT_OUTSIDE) if self.independent else OUTSIDE

    @property
    def plain(self) -> tuple[float, float]:
        """Range of strengths of pairs and of effects outside the catalogue."""
        return (PLAIN_NOISES, independent.MOST) if self.independent else (PLAIN, STRONG)

    def partners(self, effect: str) -> list[str]:
        """Effects that may form a pair with this one."""
        return independent.partners(effect) if self.independent else partners(effect)


FEW = {"null": 24, "single": 56}
POOR = {"mass_error": 0.1, "com_error": 0.01}  # errors of a real robot's URDF: relative, and m
ANOTHERS: dict[str, Any] = {"singles": independent.SINGLES, "arms": tuple(ARMS), "independent": True,
                            "strengths": (independent.LEAST, independent.MOST)}  # fmt: skip
SLOW = {"learnt": ("slow_ramps", "slow_ramps"), "held_out": ("hold_poses", "slow_ramps"), "reach": 0.2, "speed": 0.15}
SETS = {
    "main": Design(1, {"null": 100, "single": 80, "pair": 30, "outside": 30}),
    "positions": Design(2, FEW, recording={"with_effort": False}),
    "teleoperation": Design(3, FEW, recording=AS_A_PERSON),
    "no_command": Design(4, FEW, singles=IN_EFFORT, recording={"with_command": False}),
    "poor_urdf": Design(10, FEW, singles=BESIDE_OFFSETS, recording={"with_command": False, "imperfect": POOR}),
    "other_arm": Design(5, {"null": 33, "single": 27, "pair": 10, "outside": 10}, arms=("arm6b", "arm7")),
    "firmware": Design(8, {"null": 20, "single": 16}, singles=FIRMWARE, strengths=(0.7, 1.5)),
    "ties": Design(6, {"tie": 80}, recording=SLOW),
    "independent": Design(11, {"null": 80, "single": 96, "pair": 32, "outside": 32}, **ANOTHERS),
    "independent_teleoperation": Design(
        12,
        {"null": 40, "single": 56, "pair": 16, "outside": 8},
        recording={"kinds": independent.AS_A_PERSON, "hz": 30.0},
        **ANOTHERS,
    ),
}


@dataclass(frozen=True)
class Label:
    """Ground truth of a case; question: for a tie, the two effects a user wants to distinguish, one of them true."""

    index: int
    kind: str
    effects: tuple[str, ...]
    strength: float
    arm: str
    question: tuple[str, ...] = ()


def case_rng(name: str, seeds: str, index: int) -> np.random.Generator:
    """The generator of one case of a set; it does not depend on the other cases."""
    return np.random.default_rng([SEEDS[seeds], SETS[name].number, index])


def labels(name: str, seeds: str) -> list[Label]:
    """All labels of a set; the kinds of case are interleaved, so that any first few are a fair mixture."""
    design = SETS[name]
    places = [((k + 0.5) / count, kind, k) for kind, count in design.counts.items() for k in range(count)]
    return [
        _label(design, index, kind, k, case_rng(name, seeds, index))
        for index, (_, kind, k) in enumerate(sorted(places))
    ]


def _label(design: Design, index: int, kind: str, k: int, rng: np.random.Generator) -> Label:
    """The k-th case of its kind."""
    rotation = design.outside if kind == "outside" else design.singles
    arm = design.arms[(k + k // len(rotation)) % len(design.arms)]
    effect = rotation[k % len(rotation)]
    if kind == "null":
        return Label(index, kind, (), 0.0, arm)
    if kind == "single":
        return Label(index, kind, (effect,), draw_strength(rng, *design.strengths), arm)
    if kind == "outside":
        return Label(index, kind, (effect,), draw_strength(rng, *design.plain), arm)
    if kind == "pair":
        strength, other = draw_strength(rng, *design.plain), str(rng.choice(design.partners(effect)))
        return Label(index, kind, (effect, other), strength, arm)
    question = TIES[k % len(TIES)]
    return Label(index, kind, (question[k // len(TIES) % 2],), draw_strength(rng, 0.5, 1.5), arm, question)


def draw(name: str, seeds: str, label: Label) -> Case | independent.IndependentCase:
    """The robot and recordings of a label; a robot that never comes to rest (too much friction) is redrawn."""
    rng = case_rng(name, seeds, label.index)
    if SETS[name].independent:
        return independent.draw(label.effects, label.arm, label.strength, rng.spawn(1)[0], **SETS[name].recording)
    recording: dict[str, Any] = {"seconds": 6.0, "with_velocity": False, **SETS[name].recording}
    return draw_at_rest(label.effects, label.arm, rng, label.strength or PLAIN, **recording)


def run_case(name: str, seeds: str, label: Label, oracle: str = "singles") -> dict[str, Any]:
    """Draw a case, write a user's files and diagnose them; the row has the label and the answer.

    oracle: "none", "singles" or "all": cases for which a refit with the true effects is made. An error becomes a row.
    """
    row: dict[str, Any] = {"index": label.index, "label": asdict(label)}
    begun = time.perf_counter()
    try:
        case = draw(name, seeds, label)
        row["label"] |= {"values": case.hidden, "joints": places(case.hidden)}
        if isinstance(case, independent.IndependentCase):
            row["label"] |= {"visibility": dict(case.visibility), "shown": case.shown}
        with tempfile.TemporaryDirectory() as folder:
            model = RobotModel.load(case.write(folder))
            row["label"]["beyond"] = beyond(model, case.hidden)
            known = {k: v for k, v in CATALOGUE.items() if label.kind != "outside" or k not in label.effects}
            begun = time.perf_counter()
            found = _diagnose(model, folder, known)
            row |= {"seconds": time.perf_counter() - begun, "found": found.as_dict()}
            if isinstance(case, Case) and label.kind == "tie":
                row["next"] = ask_again(case, model, folder, found, label)
            if label.kind in {"none": (), "singles": ("single",), "all": ("single", "pair")}[oracle]:
                row |= oracle_of(model, folder, label.effects)
    except Exception as error:  # counted as a wrong answer, not hidden
        row |= {"failed": f"{type(error).__name__}: {error}", "seconds": time.perf_counter() - begun}
    return row


def _diagnose(model: RobotModel, folder: str, known: Mapping[str, Any]) -> Diagnosis:
    train, test = (load_recordings(f"{folder}/{part}") for part in ("train", "test"))
    return diagnose(model, train, test, catalogue=known, jobs=1)


def beyond(model: RobotModel, hidden: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[str]:
    """True values that lie outside the bounds that the model gives a parameter, as "effect.parameter[joint]"."""
    found = []
    for effect, values in hidden.items():
        for parameter in CATALOGUE[effect].parameters if effect in CATALOGUE else ():
            low, high = model.parameter_bounds(parameter)
            names = model.joints if parameter.per == "joint" else model.arms
            found += [f"{effect}.{parameter.name}[{at}]" for at, value in values.get(parameter.name, {}).items()
                      if not low[names.index(at)] <= value <= high[names.index(at)]]  # fmt: skip
    return found


def oracle_of(model: RobotModel, folder: str, effects: tuple[str, ...]) -> dict[str, Any]:
    """Held-out error of the model refitted with the true effects on all joints, as an upper bound."""
    train, test = (load_recordings(f"{folder}/{part}") for part in ("train", "test"))
    try:
        for name in effects:
            model = add_effect(model, name, train, test).after.model
        return {"oracle": float(compare(model, test).error[0])}
    except Exception as error:  # not an error of the diagnosis
        return {"oracle": None, "oracle_failed": f"{type(error).__name__}: {error}"}


def ask_again(case: Case, model: RobotModel, folder: str, found: Diagnosis, label: Label) -> dict[str, Any] | None:
    """If the question is still open: record the proposed motion twice, for training and test, and diagnose again.

    The question is that of the diagnosis if it declares a tie, else the user's. If the first recordings cannot show the
    effects, the motion is chosen for their typical sizes. None if the first answer settles the question.
    """
    pair = found.question((label.question[0], label.question[1]))
    if pair is None:
        return None
    train = load_recordings(f"{folder}/train")
    home = np.median(np.concatenate([r.position for r in train]), axis=0)
    seen = not set(pair) & set(found.unobservable) and found.verdict != "nothing_missing"
    begun = time.perf_counter()
    proposal = propose_motion(model, pair, train if seen else (), centre=home)
    seconds = time.perf_counter() - begun
    motion = Motion(_between(proposal.time, proposal.command), float(proposal.time[-1]), proposal.kind)
    for part in ("train", "test"):
        take = case.record(motion, f"decides-{part}")
        save_recording(take, f"{folder}/{part}/{take.name}.csv")
    again = _diagnose(model, folder, CATALOGUE)
    decision = decide(model, pair, *(load_recordings(f"{folder}/{part}") for part in ("train", "test")))
    return {
        "asked": list(pair),
        "kind": proposal.kind,
        "separation": proposal.separation,
        "log_likelihood": proposal.log_likelihood,
        "seconds": seconds,
        "found": again.as_dict(),
        "decision": decision.as_dict(),
    }


def _between(time: np.ndarray, command: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Interpolate commands (T, n) at times (T,) linearly."""
    return lambda t: np.stack([np.interp(t, time, column) for column in command.T], axis=1)


def brute_case(name: str, seeds: str, label: Label) -> dict[str, Any]:
    """The baseline: refit every effect of the catalogue and name the best on held-out recordings, whatever its gain."""
    row: dict[str, Any] = {"index": label.index, "label": asdict(label)}
    begun = time.perf_counter()
    try:
        case = draw(name, seeds, label)
        with tempfile.TemporaryDirectory() as folder:
            model = RobotModel.load(case.write(folder))
            train, test = (load_recordings(f"{folder}/{part}") for part in ("train", "test"))
            begun = time.perf_counter()
            problem, fit = fit_least_squares(model, train)
            calibrated = finish(problem, fit, 0.0).model
            short, points = linearise(problem, fit, model)
            screened = screen(CATALOGUE, points, short, np.ones(model.n))
            refitted = [refit(single_trial(calibrated, item, problem.hold, False), train, test) for item in screened]
            row["named"] = min(refitted, key=lambda c: c.held_out.score).kind.name
    except Exception as error:
        row["failed"] = f"{type(error).__name__}: {error}"
    return row | {"seconds": time.perf_counter() - begun}


def sealed(name: str, seeds: str) -> str:
    """All labels of a set, as the text written before the first diagnosis."""
    rows = ",\n".join(json.dumps(asdict(label)) for label in labels(name, seeds))
    return f'{{"set": "{name}", "seeds": "{seeds}", "labels": [\n{rows}\n]}}\n'
