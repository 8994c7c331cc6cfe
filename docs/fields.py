"""Docstrings in the reference: a line `name: text` becomes an item of a list."""

from __future__ import annotations

import re
from typing import Any

import griffe

FIELD = re.compile(r"^([A-Za-z_*][\w*, ]{0,80}): (\S.*)")


def listed(text: str) -> str:
    """The text with its fields as Markdown items; lines that continue one stay in it."""
    summary, *lines = text.split("\n")
    out, inside = [summary], False
    for line in lines:
        field = FIELD.match(line)
        if field:
            out += [*([] if inside else [""]), f"- `{field[1]}`: {field[2]}"]
        elif inside and line.startswith(" "):
            out.append(f"    {line.strip()}")
        else:
            out += [*([""] if inside else []), line]
        inside = bool(field) or (inside and line.startswith(" "))
    return "\n".join(out)


class Fields(griffe.Extension):
    """Lists the fields of every docstring."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring in place."""
        if obj.docstring:
            obj.docstring.value = listed(obj.docstring.value)
