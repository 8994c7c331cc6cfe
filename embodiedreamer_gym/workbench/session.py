"""Session: state and actions of the workbench, without the page; actions are deterministic and can be replayed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from embodiedreamer_gym.diagnosis import Diagnosis
from embodiedreamer_gym.diagnosis.regimes import REGIMES
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import write_json
from embodiedreamer_gym.io.progress import ProgressCallback, silent
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.workbench import trial
from embodiedreamer_gym.workbench.long_actions import LONG
from embodiedreamer_gym.workbench.measure import Measure
from embodiedreamer_gym.workbench.state import State, Step

if TYPE_CHECKING:
    from embodiedreamer_gym.workbench.rehearsal import Rehearsal

MOST_UNDO = 200


@dataclass(frozen=True, eq=False)
class Job:
    """Long work of an action: `run` may be called in another thread; pass its result to `Session.finish`."""

    name: str
    run: Callable[[ProgressCallback], Any]
    take: Callable[[Any], None]


class Session:
    """A model, recordings for fitting and evaluation, and what was tried so far.

    train, test: recordings of the model's robot; test is held out and gives the error.
    out: file that `accept` writes; jobs, seed: number of processes and random seed of a diagnosis.
    """

    EDITS = ("set_effect", "set_joints", "set_joint", "set_size", "set_value", "keep", "undo", "redo", "take", "accept")
    VIEWS = ("choose_recording", "choose_joint", "choose_time", "jump")
    JOBS = tuple(LONG)

    def __init__(
        self, model: RobotModel, train: Sequence[Recording], test: Sequence[Recording], out: str | Path = "better.json",
        jobs: int = 1, seed: int = 0,
    ) -> None:  # fmt: skip
        self.train, self.test, self.out = tuple(train), tuple(test), Path(out)
        self.recordings = tuple(dict.fromkeys((*self.test, *self.train)))
        self.jobs, self.seed = jobs, seed
        self.measure = Measure(model, self.test, model.name)
        self.state = State(model, (Step("nominal", model),))
        self.recording, self.joint, self.time = self.recordings[0], model.joints[0], 0.0
        self.log: list[dict[str, Any]] = []
        self.tried: list[dict[str, Any]] = []
        self.diagnosis: Diagnosis | None = None
        self.rehearsal: Rehearsal | None = None
        self.accepted: Path | None = None
        self.job: Job | None = None
        self._past: list[State] = []
        self._future: list[State] = []
        self._drag: tuple = ()

    # ---- what the page shows ------------------------------------------------------------------------------------

    @property
    def model(self) -> RobotModel:
        """The model shown."""
        return self.state.model

    @property
    def before(self) -> RobotModel:
        """The model to compare with: the last kept one, or the one kept before if the last kept one is shown."""
        kept = [step.model for step in self.state.steps if step.model is not self.model]
        return kept[-1] if kept else self.model

    @property
    def error(self) -> float:
        """Held-out error of the model shown, identical to that of `compare`."""
        return self.measure.error(self.model)

    @property
    def staircase(self) -> list[tuple[str, float]]:
        """Label and held-out error of every kept model, and of the model shown if it is not the last kept one."""
        shown = [(step.label, self.measure.error(step.model)) for step in self.state.steps]
        if self.model is not self.state.base:
            shown.append((self.state.label or f"trying {self.state.effect.replace('_', ' ')}", self.error))
        return shown

    def can(self, direction: str) -> bool:
        """Whether there is something to undo or to redo."""
        return bool({"undo": self._past, "redo": self._future}[direction])

    # ---- actions ------------------------------------------------------------------------------------------------

    def do(self, action: str, **given: Any) -> None:
        """Do one action by its name and log it; a long action runs to its end.

        Raises: EmbodieDreamerError where it cannot be done; then nothing has changed.
        """
        if action in self.JOBS:
            job = self.start(action, **given)
            try:
                result = job.run(silent)
            except BaseException:
                self.cancel()
                raise
            self.finish(result)
            return
        if action not in self.EDITS + self.VIEWS:
            raise EmbodieDreamerError(f"there is no action '{action}'.")
        if self.job and action in self.EDITS:
            raise EmbodieDreamerError(f"'{self.job.name}' is running; wait for it, or stop it.")
        getattr(self, f"_{action}")(**given)
        self.log.append({"action": action, **given})

    def start(self, action: str, **given: Any) -> Job:
        """Start a long action; edits are refused until `finish` or `cancel`."""
        if self.job:
            raise EmbodieDreamerError(f"'{self.job.name}' is running; wait for it, or stop it.")
        if action not in self.JOBS:
            raise EmbodieDreamerError(f"there is no long action '{action}'.")
        run, take = LONG[action](self, **given)
        note = {"action": action, **given}

        def taken(result: Any) -> None:
            take(result)
            self.log.append(note)

        self.job = Job(action.replace("_", " "), run, taken)
        return self.job

    def finish(self, result: Any) -> None:
        """Apply the result of the long action."""
        job, self.job = self.job, None
        if job is not None:
            job.take(result)

    def cancel(self) -> None:
        """Cancel the long action; the session stays unchanged."""
        self.job = None

    @classmethod
    def replay(cls, log: Sequence[dict[str, Any]], *arguments: Any, **options: Any) -> Session:
        """A new session in which the actions of a log are replayed; the other arguments are passed to the session."""
        session = cls(*arguments, **options)
        for entry in log:
            session.do(**entry)
        return session

    # ---- views --------------------------------------------------------------------------------------------------

    def _choose_recording(self, name: str) -> None:
        self.recording, self.time = self._find(name), 0.0

    def _choose_joint(self, joint: str) -> None:
        self._joint_index(joint)
        self.joint = joint

    def _choose_time(self, seconds: float) -> None:
        self.time = min(max(float(seconds), 0.0), self.recording.duration)

    def _jump(self, joint: str, regime: str) -> None:
        if regime not in ("all", *REGIMES):
            raise EmbodieDreamerError(f"there is no regime '{regime}'; there are all, {', '.join(REGIMES)}.")
        recording, at = self.measure.worst_instant(self.model, self._joint_index(joint), regime)
        self.recording, self.joint = recording, joint
        self.time = float(recording.time[at] - recording.time[0])

    # ---- edits --------------------------------------------------------------------------------------------------

    def _set_effect(self, name: str = "") -> None:
        base = self.state.base
        if not name:
            self.change(replace(self.state, model=base, effect="", joints=(), label=""))
        elif any(effect.name == name for effect in base.effects):
            self.change(replace(self.state, model=base, effect=name, joints=base.joints, label=""))
        else:
            model = trial.with_trial(base, name, base.joints)
            self.change(replace(self.state, model=model, effect=name, joints=base.joints, label=""))

    def _set_joints(self, joints: Sequence[str]) -> None:
        state, chosen = self.state, tuple(j for j in self.model.joints if j in tuple(joints))
        if not state.effect or not chosen:
            raise EmbodieDreamerError("choose an effect and at least one joint first.")
        if any(effect.name == state.effect for effect in state.base.effects):
            raise EmbodieDreamerError(f"{state.effect} has been kept; its joints stay as they are.")
        model = trial.on_joints(state.base, self.model, state.effect, chosen)
        self.change(replace(state, model=model, joints=chosen, label=""))

    def _set_joint(self, joint: str, on: bool) -> None:
        self._joint_index(joint)
        self._set_joints([j for j in self.model.joints if (on if j == joint else j in self.state.joints)])

    def _set_size(self, parameter: str, size: float, place: str = "") -> None:
        rows = trial.rows_at(self.model, parameter, (place,) if place else ())
        values = {row.key.place: trial.value_of(row, float(size)) for row in rows}
        self._set(parameter, values, ("size", parameter, place))

    def _set_value(self, parameter: str, value: float, place: str = "") -> None:
        rows = trial.rows_at(self.model, parameter, (place,) if place else ())
        values = {row.key.place: float(min(max(value, row.low), row.high)) for row in rows}
        self._set(parameter, values, ("value", parameter, place))

    def _set(self, parameter: str, values: dict[str, float], drag: tuple) -> None:
        model = self.model.with_values({parameter: values})
        self.change(replace(self.state, model=model, label=""), drag)

    def _keep(self) -> None:
        if self.model is self.state.base:
            raise EmbodieDreamerError("the current model has already been kept.")
        self.note("kept")
        label = self.state.label or (f"+ {self.state.effect}" if self.state.effect else "by hand")
        self.change(State(self.model, (*self.state.steps, Step(label, self.model))))

    def _undo(self) -> None:
        self._go(self._past, self._future, "undo")

    def _redo(self) -> None:
        self._go(self._future, self._past, "redo")

    def _go(self, source: list[State], target: list[State], what: str) -> None:
        if not source:
            raise EmbodieDreamerError(f"there is nothing to {what}.")
        target.append(self.state)
        self.state, self._drag = source.pop(), ()

    def _accept(self) -> None:
        if self.out.exists() and self.accepted != self.out:
            raise EmbodieDreamerError(f"{self.out} exists already; name another file with --out.")
        if self.model is not self.state.base:
            self._keep()
        self.model.save(self.out)
        history = {"model": self.out.name, "error": {"unit": self.measure.signals.unit or "rad"}, "tried": self.tried}
        history["error"]["steps"] = [list(step) for step in self.staircase]
        write_json(history, self.out.with_name(f"{self.out.stem}.history.json"))
        self.accepted = self.out

    def _take(self) -> None:
        if self.diagnosis is None:
            raise EmbodieDreamerError("there is no diagnosis yet.")
        found = self.diagnosis
        steps = [Step("nominal", found.nominal), Step("calibrated", found.calibrated)]
        if found.effects or found.closest:
            steps.append(Step(f"+ {', '.join(found.effects or found.closest)}", found.model))
        self.change(State(steps[-1].model, tuple(steps)))

    def change(self, new: State, drag: tuple = ()) -> None:
        """Go to a new state; consecutive changes with the same `drag`, of one slider, are undone as a whole."""
        if not drag or drag != self._drag:
            self._past = [*self._past[1 - MOST_UNDO :], self.state]
        self._future, self._drag, self.state = [], drag, new

    def note(self, what: str, **more: Any) -> None:
        """Record a trial with its held-out error, for the history."""
        values = {row.name: row.value for row in self.model.parameters().of_effect(self.state.effect)}
        self.tried.append({"what": what, "effect": self.state.effect, **more, "error": self.error, "values": values})

    # ---- names --------------------------------------------------------------------------------------------------

    def _find(self, name: str) -> Recording:
        for recording, known in zip(self.recordings, self.names, strict=True):
            if known == name:
                return recording
        raise EmbodieDreamerError(f"there is no recording '{name}'; there are {', '.join(self.names)}.")

    @property
    def names(self) -> tuple[str, ...]:
        """Unique names of the recordings, the held-out ones first."""
        names = [r.name for r in self.recordings]
        return tuple(name if names.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(names))

    def _joint_index(self, joint: str) -> int:
        if joint not in self.model.joints:
            raise EmbodieDreamerError(f"there is no joint '{joint}'; there are {', '.join(self.model.joints)}.")
        return self.model.joints.index(joint)
