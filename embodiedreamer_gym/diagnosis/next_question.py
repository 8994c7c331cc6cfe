"""Which two effects the next motion has to distinguish."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from embodiedreamer_gym.effects import Effect


def next_question(
    verdict: str, effects: Sequence[str], ranking: Sequence[str], unobservable: Sequence[str],
    catalogue: Mapping[str, type[Effect]], asked: tuple[str, str] | None = None,
) -> tuple[str, str] | None:  # fmt: skip
    """The two effects that a further motion has to distinguish, None where the verdict stands.

    Those of a tie; a named effect and one that it may be confused with, if these recordings cannot show that one; where
    nothing is named, the two that explain most, or else the likeliest of those that cannot be seen and its like.

    verdict, effects, unobservable: of a `Diagnosis`, unobservable with the likeliest first.
    ranking: effects that were refitted, best first.
    catalogue: that was searched.
    asked: the two that a user wants told apart, which come before what nothing speaks for.
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
