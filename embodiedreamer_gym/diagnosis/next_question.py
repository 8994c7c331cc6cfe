"""Which two effects the next motion has to distinguish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from embodiedreamer_gym.effects import Effect


def next_question(
    verdict: str, effects: Sequence[str], ranking: Sequence[str], unobservable: Sequence[str],
    catalogue: Mapping[str, type[Effect]], asked: tuple[str, str] | None = None,
) -> tuple[str, str] | None:  # fmt: skip
    """The two effects that a further motion has to distinguish, None if the verdict needs no further motion.

    For a tie, these are its effects. For a named effect, they are that effect and one that it may be confused with, if
    these recordings cannot show the latter. If no effect is named, they are the two that explain most, or else the most
    likely unobservable effect and one that it may be confused with.

    verdict, effects, unobservable: of a `Diagnosis`; the most likely come first in `unobservable`.
    ranking: effects that were refitted, best first.
    catalogue: the effects that were searched.
    asked: two effects that the user wants to distinguish; they are preferred to pairs that no result supports.
    """
    if verdict == "ambiguous":
        return effects[0], effects[1]
    if verdict == "missing":
        if asked and not set(asked) & set(effects):
            return asked
        rivals = {
            name: asked or (name, *catalogue[name].confused_with) for name in effects if not asked or name in asked
        }
        pairs = [(name, rival) for name, others in rivals.items() for rival in others if rival not in effects]
        return next((pair for pair in pairs if pair[1] in unobservable), None)
    if asked:
        return asked
    if len(ranking) > 1:
        return ranking[0], ranking[1]
    for name in unobservable:
        like = [other for other in catalogue[name].confused_with if other in catalogue]
        if like:
            return name, next((other for other in unobservable if other in like), like[0])
    return None
