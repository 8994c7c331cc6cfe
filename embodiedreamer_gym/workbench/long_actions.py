"""The session's long actions: each is a function that does the work and one that applies the result to the session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from embodiedreamer_gym.diagnosis import Addition, Diagnosis, add_effect, diagnose
from embodiedreamer_gym.io.progress import ProgressCallback
from embodiedreamer_gym.phys_aligner import Calibration, calibrate

if TYPE_CHECKING:
    from embodiedreamer_gym.workbench.rehearsal import Rehearsal

Work = tuple[Callable[[ProgressCallback], Any], Callable[[Any], None]]


def fit(session: Any) -> Work:
    """Fit all parameters of the model shown, from their current values."""
    model = session.model

    def take(found: Calibration) -> None:
        label = f"+ {session.state.effect}, fitted" if session.state.effect else "calibrated"
        session.change(replace(session.state, model=found.model, label=label))
        session.note("fitted", undetermined=list(found.undetermined))

    return lambda progress: calibrate(model, session.train, progress=progress), take


def put_on(session: Any, effect: str) -> Work:
    """Add an effect to the last kept model and fit all parameters."""
    base = session.state.base
    base.with_effect(effect)  # raises for an unknown or existing effect before any work

    def take(added: Addition) -> None:
        model = added.after.model
        state = replace(session.state, model=model, effect=effect, joints=model.joints, label=f"+ {effect}, fitted")
        session.change(state)
        session.note("put on")

    return lambda progress: add_effect(base, effect, session.train, session.test, progress), take


def find(session: Any) -> Work:
    """Diagnose the model that the session started with."""
    model = session.state.steps[0].model

    def run(progress: ProgressCallback) -> Diagnosis:
        return diagnose(model, session.train, session.test, jobs=session.jobs, seed=session.seed, progress=progress)

    def take(found: Diagnosis) -> None:
        session.diagnosis = found
        ranking = [{"effect": r.effect, "held_out_chi2": r.held_out_chi2, "gain": r.gain} for r in found.ranking]
        session.tried.append({"what": "diagnosed", "verdict": found.sentence, "ranking": ranking})

    return run, take


def propose(session: Any, first: str, second: str, table: float | None = None) -> Work:
    """Propose the motion that distinguishes two effects, and simulate it; table: height of the table, m."""
    from embodiedreamer_gym.diagnosis.experiment_design import propose_motion  # imports MuJoCo
    from embodiedreamer_gym.workbench.rehearsal import rehearse

    nominal, shown = session.state.steps[0].model, session.model

    def run(progress: ProgressCallback) -> Rehearsal:
        pair = (first, second)
        proposal = propose_motion(nominal, pair, session.train, table=table, seed=session.seed, progress=progress)
        return rehearse(shown, proposal, table)

    def take(rehearsal: Rehearsal) -> None:
        session.rehearsal = rehearsal

    return run, take


LONG: dict[str, Callable[..., Work]] = {"fit": fit, "put_on": put_on, "diagnose": find, "propose": propose}
