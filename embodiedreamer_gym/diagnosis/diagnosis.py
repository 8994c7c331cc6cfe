"""The result of a diagnosis: verdict, effects, joints, parameters, errors, and unobservable effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from embodiedreamer_gym.diagnosis.compare import compare
from embodiedreamer_gym.diagnosis.comparison import GUESSED, gains_are_guessed
from embodiedreamer_gym.diagnosis.error_ceiling import SIGNALS
from embodiedreamer_gym.diagnosis.held_out import HeldOut
from embodiedreamer_gym.diagnosis.next_question import next_question
from embodiedreamer_gym.diagnosis.null_distribution import NullDistribution
from embodiedreamer_gym.diagnosis.probabilities import family_probabilities
from embodiedreamer_gym.diagnosis.search_state import SURE, Ranked, SearchState
from embodiedreamer_gym.diagnosis.trajectory_error import trajectory_losses
from embodiedreamer_gym.diagnosis.verdict import explained, rank_notes
from embodiedreamer_gym.diagnosis.wording import Attempt, explainable_text, probabilities_text, verdict_text
from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.effort_sensor import EffortSensor
from embodiedreamer_gym.io.tables import MILLI, finite
from embodiedreamer_gym.phys_aligner.linear_baseline import TERMS
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import ParameterKey, RobotModel
from embodiedreamer_gym.simulation import Rollout

LABELS = ("nominal", "calibrated", "with_effect", "noise")


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Result of a diagnosis: the verdict on which effects a model lacks.

    verdict: "nothing_missing", "missing", "ambiguous" or "unknown"; sentence: the same in words.
    effects: names in the order of the search (all effects of a tie).
    family: the missing family of effects, if the family is probable enough and no single effect is, else None.
    members: effect -> probability, given that one of the fitted candidates is right, the most likely first.
    excess: chi2 of the worst joint with the effects, on held-out or fitted motion, relative to the 95 % quantile of
        faultless robots (robots whose model lacks no effect); above 1.3 the laws are not exact.
    explainable: joint -> signals -> share of the calibrated error that is predictable from these signals and the
        previous ones; empty if the effects leave little more than the sensor noise (see `explainable_shares`).
    closest: if the verdict is "unknown", the effects that lower the held-out error most; they are not the answer.
    joints: effect -> joints or arms on which it acts.
    parameters: effect -> joint -> value, low, high, unit.
    ranking: the effects that were refitted, best first.
    error, end_effector_mm: nominal, calibrated, with_effect (None if no effect helps), noise and, for recordings
        without a command, least_squares (see `least_squares_rms`); error in `unit`.
    unobservable: effects that these recordings cannot show, the most likely first.
    unexplained: joint -> share of its excess error that is left.
    steps: (label, held-out error) of the nominal model, the calibrated model and each added effect.
    p_value: share of faultless robots with an error as large as that of the calibrated model.
    unit: "rad"; "N m" or "A" for recordings without a command.
    chi2: held-out mean square error per joint over the variance of the sensor noise: calibrated, with_effect, and of
        faultless robots (usual: median, most: 95 % quantile).
    model: the model with the effects that were found.
    notes: caveats of the verdict.
    learned_from: names of held-out recordings that were also used for fitting; the errors are those of the others.
    """

    verdict: str
    sentence: str
    effects: tuple[str, ...]
    joints: dict[str, tuple[str, ...]]
    parameters: dict[str, dict[str, dict[str, Any]]]
    ranking: tuple[Ranked, ...]
    error: dict[str, float | None]
    end_effector_mm: dict[str, float | None]
    unobservable: tuple[str, ...]
    unexplained: dict[str, float]
    steps: tuple[tuple[str, float], ...]
    p_value: float
    rollouts: int
    seconds: float
    unit: str
    chi2: dict[str, list[float]]
    closest: tuple[str, ...]
    nominal: RobotModel
    calibrated: RobotModel
    model: RobotModel
    family: str | None
    members: dict[str, float]
    excess: float
    explainable: dict[str, dict[str, float]]
    notes: tuple[str, ...] = ()
    learned_from: tuple[str, ...] = ()

    @property
    def best(self) -> str | None:
        """Name of the first effect, None if none is named."""
        return self.effects[0] if self.effects else None

    @property
    def gains_guessed(self) -> bool:
        """Whether servo gains of the nominal model are guessed by the package and used; inverse runs use no gains."""
        return self.unit == "rad" and gains_are_guessed(self.nominal)

    @property
    def effort_offsets(self) -> dict[str, dict[str, Any]]:
        """Joint -> value, low, high, unit of the effort at no torque (sensor zero, spring balance), if significant."""
        return self._of_sensor("offset", self.unit)

    @property
    def effort_delays(self) -> dict[str, dict[str, Any]]:
        """Arm -> value, low, high, unit of the delay of logged efforts behind logged positions, if significant."""
        return self._of_sensor("delay", "s")

    def _of_sensor(self, parameter: str, unit: str) -> dict[str, dict[str, Any]]:
        rows = self.model.parameters().select(ParameterKey(parameter, EffortSensor.name))
        return {r.key.place: {"value": r.value, "low": r.interval[0], "high": r.interval[1], "unit": unit}
                for r in rows if r.interval and not r.interval[0] <= 0.0 <= r.interval[1]}  # fmt: skip

    def question(self, asked: tuple[str, str] | None = None) -> tuple[str, str] | None:
        """The two effects that the next motion has to distinguish, see `next_question`.

        asked: two effects that the user wants to distinguish.
        """
        if self.unit != "rad" and self.verdict != "ambiguous":
            return None  # without commands, no other motion shows more
        ranking, catalogue = [r.effect for r in self.ranking], self.nominal.catalogue
        return next_question(self.verdict, self.effects, ranking, self.unobservable, catalogue, asked)

    def models_by_label(self) -> dict[str, RobotModel]:
        """The nominal and the calibrated model, and the model with the named or closest effects."""
        models = {"nominal": self.nominal, "calibrated": self.calibrated}
        if self.effects or self.closest:
            models[f"with {', '.join(self.effects or self.closest)}".replace("_", " ")] = self.model
        return models

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON."""
        return {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "notes": list(self.notes),
            "learned_from": list(self.learned_from),
            "effects": list(self.effects),
            "closest": list(self.closest),
            "family": self.family,
            "members": self.members,
            "excess": self.excess,
            "explainable": self.explainable,
            "joints": {k: list(v) for k, v in self.joints.items()},
            "parameters": self.parameters,
            **({"effort_offsets": self.effort_offsets} if self.effort_offsets else {}),
            **({"effort_delays": self.effort_delays} if self.effort_delays else {}),
            "ranking": [{k: v for k, v in asdict(r).items() if k != "screening"} for r in self.ranking],
            "gains_guessed": self.gains_guessed,
            "error": {"unit": self.unit, **self.error},
            "end_effector_mm": self.end_effector_mm,
            "unobservable": list(self.unobservable),
            "next_question": list(self.question() or ()),
            "unexplained": self.unexplained,
            "steps": [list(step) for step in self.steps],
            "p_value": self.p_value,
            "chi2": self.chi2,
            "rollouts": self.rollouts,
            "seconds": self.seconds,
        }

    def __str__(self) -> str:
        lines = [*self.notes, self.sentence, "", f"{'held-out error':<34} {MILLI[self.unit]:>10}"]
        for label, error in self.steps:
            note = f" ({GUESSED})" if label == "nominal" and self.gains_guessed else ""
            lines.append(f"  {label + note:<32} {error * 1e3:>10.3f}")
        if self.error["least_squares"] is not None:
            lines.append(f"  {'plain least squares':<32} {self.error['least_squares'] * 1e3:>10.3f}  ({TERMS})")
        lines.append(f"  {'noise floor':<32} {(self.error['noise'] or 0) * 1e3:>10.3f}")
        if self.ranking:
            lines += ["", f"{'rank  effect':<36} {'held-out chi2/n':>16} {'gain (log)':>18}"]
            for k, r in enumerate(self.ranking, 1):
                lines.append(f"{k:>4}  {r.effect:<30} {r.held_out_chi2:>16.2f} {r.gain:>10.2f} +- {r.gain_error:.2f}")
                lines += [f"      not named: {r.note}"] if r.note else []
        if len(self.members) > 1 and self.effects:
            lines.append(f"probabilities: {probabilities_text(self.members)}")
        sensor = (("offset of the effort", self.effort_offsets), ("delay of the effort", self.effort_delays))
        for effect, rows in (*self.parameters.items(), *sensor):
            lines += [""] if rows else []
            for joint, row in rows.items():
                spread = "" if row["low"] is None else f"  [{row['low']:.4g}, {row['high']:.4g}]"
                lines.append(f"{effect} of {joint}: {row['value']:.4g} {row['unit']}{spread}")
        if self.unobservable:
            lines += ["", f"this motion and these sensors cannot show: {', '.join(self.unobservable)}"]
        if question := self.question():
            lines.append(
                f"to distinguish {' and '.join(question)}: embodiedreamer excite --separate {','.join(question)}"
            )
        if self.unexplained:
            left = ", ".join(f"{j} {100 * share:.0f} %" for j, share in self.unexplained.items())
            lines.append(f"unexplained part of the excess error: {left}")
        lines += [explainable_text(joint, shares) for joint, shares in self.explainable.items()]
        lines.append(f"{self.rollouts} rollouts, {self.seconds:.1f} s")
        return "\n".join(lines)


def summarise(
    attempt: Attempt, *, model: RobotModel, ranking: Sequence[Ranked], unobservable: tuple[str, ...],
    catalogue: Mapping[str, type[Effect]], test: Sequence[Recording], rollouts: int, seconds: float, baseline: float | None,
    notes: tuple[str, ...] = (), learned_from: tuple[str, ...] = (),
) -> Diagnosis:  # fmt: skip
    """Put a search's results into a Diagnosis."""
    verdict, calibrated, final, p_value = attempt.verdict, attempt.calibrated, attempt.final, attempt.p_value
    state = attempt.state
    steps, tie, base, held, null = state.steps, state.tie, state.base, state.held, state.null
    named, kept = verdict in ("missing", "ambiguous"), bool(steps)
    better = final.model if kept else calibrated.model
    chain = (
        [*tie, *(c.kind.name for c in steps if c.kind.name not in tie)]
        if verdict == "ambiguous"
        else [c.kind.name for c in steps]
    )
    effects = tuple(chain) if named else ()
    models = {"nominal": model, "calibrated": calibrated.model}
    if kept:
        models["with_effect"] = better
    comparison = compare(list(models.values()), test, labels=list(models))
    errors: dict[str, float] = dict(zip(models, comparison.error.tolist(), strict=True))
    error: dict[str, float | None] = {label: errors.get(label) for label in LABELS}
    error |= {"noise": comparison.noise, "least_squares": baseline}
    millimetres: dict[str, float] = dict(zip(models, comparison.end_effector_mm.tolist(), strict=True))
    millimetres["noise"] = np.nan if comparison.signals.by_effort else _noise_mm(model, test)
    share = explained(base, held, null.chi2)
    unexplained = {
        joint: float(1.0 - s) for joint, s in zip(model.joints, share, strict=True) if np.isfinite(s) and 1.0 - s > 0.1
    }
    stages = [("nominal", errors["nominal"]), ("calibrated", errors["calibrated"])]
    if kept:
        between = compare([c.model for c in steps[:-1]], test).error.tolist() if len(steps) > 1 else []
        stages += [(f"+ {c.kind.name}", e) for c, e in zip(steps, [*between, errors["with_effect"]], strict=True)]
    parameters = {c.kind.name: _parameters(better, c.kind.name) for c in steps}
    family = _family(verdict, state, catalogue)
    ceiling = np.zeros((0, len(SIGNALS))) if attempt.explainable is None else attempt.explainable
    explainable: dict[str, dict[str, float]] = {
        joint: dict(zip(SIGNALS, row.tolist(), strict=True)) for joint, row in zip(model.joints, ceiling, strict=False)
    }
    remarks = rank_notes([r.effect for r in ranking], [r.gain for r in ranking], effects, catalogue)
    return Diagnosis(
        verdict=verdict, sentence=verdict_text(attempt, effects, {e: _places(rows) for e, rows in parameters.items()}, family),
        effects=effects, joints={e: _places(rows) for e, rows in parameters.items()}, parameters=parameters,
        ranking=tuple(replace(r, note=note) for r, note in zip(ranking, remarks, strict=True)), error=error,
        end_effector_mm={label: finite(millimetres.get(label, np.nan)) for label in LABELS}, unobservable=unobservable,
        unexplained=unexplained, steps=tuple(stages), p_value=p_value, rollouts=rollouts, seconds=seconds,
        unit=comparison.unit, chi2=_chi2(base, held, null, kept),
        closest=() if named else tuple(c.kind.name for c in steps), nominal=model, calibrated=calibrated.model, model=better,
        family=family, members=state.probabilities, excess=state.excess, explainable=explainable, notes=notes, learned_from=learned_from,
    )  # fmt: skip


def _family(verdict: str, state: SearchState, catalogue: Mapping[str, type[Effect]]) -> str | None:
    """The family of the tied effects, if it is probable enough."""
    if verdict != "ambiguous":
        return None
    total = family_probabilities({name: state.probabilities.get(name, 0.0) for name in state.tie}, catalogue)
    name, probability = next(iter(total.items()))
    return name if probability >= SURE and len(state.steps) == 1 else None


def _chi2(base: HeldOut, held: HeldOut, null: NullDistribution, kept: bool) -> dict[str, list[float]]:
    """Held-out chi2 per joint, and the median and 95th percentile of that of faultless robots."""
    usual, most = np.quantile(null.chi2, (0.5, 0.95), axis=0)
    chi2 = {"calibrated": base.chi2, "usual": usual, "most": most} | ({"with_effect": held.chi2} if kept else {})
    return {label: [float(x) for x in values] for label, values in chi2.items()}


def _noise_mm(model: RobotModel, test: Sequence[Recording]) -> float:
    """Mean translation error of the end effectors, mm, caused by sensor noise alone."""
    rng = np.random.default_rng(0)
    noisy = [
        Rollout(r.time, r.position + r.sigma * rng.standard_normal(r.position.shape), r.position, r.position)
        for r in test
    ]
    return 1e3 * float(trajectory_losses(model, test, noisy)[0])


def _parameters(model: RobotModel, name: str) -> dict[str, dict[str, Any]]:
    """Joint -> value, low, high, unit of an effect's first parameter; "joint.parameter" for its other parameters."""
    rows: dict[str, dict[str, Any]] = {}
    first = next(e for e in model.effects if e.name == name).parameters[0].name
    for row in model.parameters().of_effect(name):
        parameter, place = row.key.parameter, row.key.place
        low, high = row.interval or (None, None)
        key = place if parameter == first else f"{place}.{parameter}"
        rows[key] = {"value": row.value, "low": low, "high": high, "unit": row.unit, "parameter": parameter}
    return rows


def _places(rows: dict[str, dict[str, Any]]) -> tuple[str, ...]:
    return tuple(k for k in rows if "." not in k)
