"""Docstrings in the reference: a line `name: text` becomes an item of a list."""

from __future__ import annotations

import re
from typing import Any

import griffe

NAME = r"\*{0,2}[A-Za-z_]\w*(?:\[\"\w+\"\])?(?: \([^()]*\))?"  # with its key and shape, if it has them
NAMES = rf"{NAME}(?:, {NAME})*"
FIELD = re.compile(rf"({NAMES}): (\S.*)")
NEXT = re.compile(rf"; (?!default:)(?={NAMES}: )")


def listed(text: str) -> str:
    """The text with its fields as Markdown items; lines that continue one stay in it."""
    summary, *paragraphs = re.split(r"\n\s*\n", text)
    return "\n\n".join([summary, *map(items, paragraphs)])


def items(paragraph: str) -> str:
    """The paragraph with an item for each of its fields; what comes before the first stays as it is."""
    before: list[str] = []
    fields: list[str] = []
    for line in paragraph.split("\n"):
        if FIELD.match(line):
            fields.append(line)
        elif fields:
            fields[-1] += f" {line.strip()}"
        else:
            before.append(line)
    found = (FIELD.match(one) for field in fields for one in NEXT.split(field))
    return "\n".join(
        [
            *before,
            *([""] if before and fields else []),
            *(f"- `{one[1]}`: {one[2].rstrip(';')}" for one in found if one),
        ]
    )


class Fields(griffe.Extension):
    """Lists the fields of every docstring."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring in place."""
        if obj.docstring:
            obj.docstring.value = listed(obj.docstring.value)
