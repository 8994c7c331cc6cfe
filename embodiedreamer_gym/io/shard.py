"""Shard: one part of a list of cases, so that several jobs or machines can share the work."""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from embodiedreamer_gym.errors import EmbodieDreamerError, brief

T = TypeVar("T")
MOST = 100_000  # parts


@dataclass(frozen=True)
class Shard:
    """Part `number` of `count` parts, counted from 1.

    Raises: EmbodieDreamerError for numbers outside 1 <= number <= count <= MOST.
    """

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count <= MOST:
            raise EmbodieDreamerError(
                f"{self} is not a shard; give I/N such as 1/4, with I from 1 to N and N at most {MOST}."
            )

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read "I/N".

        Raises: EmbodieDreamerError for anything else.
        """
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
        if found is None:
            raise EmbodieDreamerError(f"{brief(text)} is not a shard; give I/N such as 1/4.")
        return cls(int(found[1]), int(found[2]))

    def of(self, items: Sequence[T]) -> list[T]:
        """The items of this part, in their order; every item is in exactly one part, and parts differ by at most one item.

        The items are dealt in rounds of `count`. A checksum of the round's number decides which part a round begins
        with, so that periodic patterns of items in the list are spread over all parts. Appending items does not move
        the others.
        """
        return [item for k, item in enumerate(items) if self._dealt(*divmod(k, self.count)) == self.number]

    def _dealt(self, turn: int, place: int) -> int:
        """The part that gets the item at a place of a round."""
        return (place + zlib.crc32(str(turn).encode())) % self.count + 1
