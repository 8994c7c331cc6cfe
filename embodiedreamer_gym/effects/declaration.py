"""Checks of an effect's declaration: name, texts, stage, methods, parameters."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

import numpy as np

from embodiedreamer_gym.effects.effect import PER, STAGES, Effect, MechanicsChange, Parameter, SignalLaw, TorqueBudget

METHODS = {SignalLaw: ("law",), TorqueBudget: ("friction", "drive"), MechanicsChange: ("change",)}
WORDS = {"symptom": "what it does to a motion", "reveals": "which motion shows it"}


def faults(kind: type[Effect]) -> Iterator[str]:
    """Faults of a class's name, texts, stage, methods and parameters, each as the end of a sentence."""
    name = getattr(kind, "name", None)
    if not isinstance(name, str) or not name.isidentifier():
        yield f"has the name {name!r}; use one plain word, name = 'my_effect'"
    base = next((b for b in METHODS if issubclass(kind, b)), None)
    if base is None:
        yield "is not a SignalLaw, a TorqueBudget or a MechanicsChange"
        return
    for word, meaning in WORDS.items():
        text = getattr(kind, word, None)
        if not isinstance(text, str) or not text.strip() or "\n" in text:
            yield f"has no {word}; say in one line {meaning}"
    for field in ("confused_with", "generalises"):
        others = getattr(kind, field)
        if not isinstance(others, tuple) or not all(isinstance(other, str) for other in others):
            yield f"has a {field} that is not a tuple of names; write ('joint_spring',), with its comma"
    stage = getattr(kind, "stage", None)
    if base is SignalLaw and stage not in STAGES:
        yield f"has the stage {stage!r}; a SignalLaw acts on one of {', '.join(STAGES)}"
    if kind.passive and base is SignalLaw and stage != "load":
        yield f"is passive on the stage '{stage}'; only a torque on the joint, stage 'load', can be"
    own = [m for m in METHODS[base] if inspect.getattr_static(kind, m) is not inspect.getattr_static(base, m)]
    if not own:
        yield f"defines no {' and no '.join(METHODS[base])}"
    for method in (*own, *(["start"] if base is SignalLaw else [])):
        if not isinstance(inspect.getattr_static(kind, method), staticmethod):
            yield f"has a {method} that is not a @staticmethod"
    yield from _parameter_faults(kind, base)


def _parameter_faults(kind: type[Effect], base: type[Effect]) -> Iterator[str]:
    given = getattr(kind, "parameters", None)
    if not isinstance(given, tuple) or not given or not all(isinstance(p, Parameter) for p in given):
        yield "has no parameters; write parameters = (Parameter(...),), with its comma"
        return
    names = [p.name for p in given]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        yield f"has the parameter '{twice[0]}' twice"
    if all(p.shape for p in given):
        yield "has only shape parameters; at least one parameter must be a size"
    for p in given:
        for fault in _absurd(p):
            yield f"has the parameter '{p.name}' {fault}"
        stage = getattr(kind, "stage", "")
        per = PER.get(stage, "joint")
        if base is not MechanicsChange and p.per != per:
            yield f"has the parameter '{p.name}' per {p.per}; on the stage '{stage}' values are per {per}"


def _absurd(p: Parameter) -> Iterator[str]:
    """Faults of one parameter."""
    bounds = f"{p.low:g} .. {p.high:g}"
    if not p.name.isidentifier() or p.name == "name":
        yield "whose name is not a plain word, or is 'name'"
    if not isinstance(p.unit, str) or not p.unit:
        yield "without a unit; use '1' for a ratio"
    if not np.isfinite([p.low, p.high, p.off, p.typical]).all():
        yield "with a number that is not finite; a limit is off at its upper bound"
    if not p.low < p.high:
        yield f"with the bounds {bounds}; the lower one must be less"
    if not (p.low <= p.typical <= p.high and p.typical > 0):
        yield f"with the typical size {p.typical:g}; it must be positive and inside {bounds}"
    if p.typical == p.off and not p.shape:
        yield f"with the typical size {p.typical:g}, at which it is off"
    if p.scale not in ("", "torque", "1/torque") or p.per not in ("joint", "arm"):
        yield f"with scale '{p.scale}', per '{p.per}'; allowed are '', 'torque', '1/torque' and 'joint', 'arm'"
    if p.starts and not (p.shape and all(p.low <= start <= p.high for start in p.starts)):
        yield f"with starts; only shape parameters may have starts, and these must be inside {bounds}"
