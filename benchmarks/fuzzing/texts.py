"""Mutations of bytes, texts, JSON and XML; each uses only a random.Random, so that a case is reproducible."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from random import Random
from typing import Any

NUMBERS = ("0", "-1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1" + "0" * 400, "9" * 5000, "1e5", "0.5", "-0.0", "1e999",
           "0x10", "1_000", "1,5", "1e", "--1", "", "true", "null", "٣", "[1]", "1+2j", "2147483648", "9223372036854775808")  # fmt: skip
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORDS = (
    "",
    " ",
    "x",
    "\x00",
    "\n",
    "é",
    "\U0001f916",
    "../../etc/passwd",
    "/",
    "%s{0}",
    "a" * 70_000,
    "None",
    "nan",
    "*",
    "-",
    "\ud800",
)
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 0.5, 1e308, -1e308, 1e-320, 2**63, 10**400, float("nan"), float("inf"), [], {}, [[]], [None], {"": 0},
    "0", *WORDS, [1e308] * 14, list(range(2000)), {"a": {"b": [1]}},
)  # fmt: skip


def change_bytes(data: bytes, rng: Random) -> bytes:
    """Cut, flip, insert, delete, repeat, blank or replace bytes."""
    kind = rng.randrange(10)
    at = rng.randrange(len(data) + 1)
    size = min(len(data) - at, 1 << rng.randrange(12))
    if kind < 2:
        return data[:at]
    if kind < 5:
        out = bytearray(data)
        for _ in range(rng.choice((1, 1, 2, 8, 64)) if out else 0):
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
        return bytes(out)
    middle = {
        5: rng.randbytes(1 << rng.randrange(10)), 6: b"", 7: data[at : at + size] * 2, 8: bytes(size), 9: b"\xff" * size,
    }[kind]  # fmt: skip
    if kind == 9 and rng.random() < 0.5:
        return rng.choice(
            (
                b"",
                b"\x00" * 64,
                rng.randbytes(256),
                b"PK\x03\x04",
                b"\x89HDF\r\n\x1a\n",
                b"\r",
                b"\xef\xbb\xbf",
                data * 3,
            )
        )
    return data[:at] + middle + data[at + (size if kind in (6, 7, 8, 9) else 0) :]


def change_encoding(text: str, rng: Random) -> bytes:
    """The text in another encoding, or with other line ends."""
    kind = rng.randrange(8)
    if kind < 4:
        return text.encode(("utf-16", "utf-32", "utf-8-sig", "utf-16-be")[kind], "replace")
    data = text.encode("utf-8", "replace")
    ends = (b"\r", b"\r\n", b"\n\n", b"\x0b")
    return data.replace(b"\n", ends[kind - 4])


def change_numbers(text: str, rng: Random) -> str:
    """Replace some of the numbers of a text."""
    places = list(NUMBER.finditer(text))
    if not places:
        return text + rng.choice(NUMBERS)
    for match in sorted(rng.sample(places, min(len(places), rng.choice((1, 1, 1, 3, 20)))), key=lambda m: -m.start()):
        text = text[: match.start()] + rng.choice(NUMBERS) + text[match.end() :]
    return text


def change_words(text: str, rng: Random) -> str:
    """Replace a name of a text, everywhere or once."""
    words = re.findall(r"[A-Za-z_]\w*", text)
    word = rng.choice(words) if words else ""
    return text.replace(word, rng.choice(WORDS), rng.choice((1, -1))) if word else rng.choice(WORDS)


def change_csv(text: str, rng: Random) -> str:
    """Drop, repeat, move, rename or lengthen columns and rows, or replace cells."""
    rows = [line.split(",") for line in text.split("\n")]
    first = next((k for k, row in enumerate(rows) if len(row) > 1), 0)
    body = rows[first:]
    kind, column = rng.randrange(8), rng.randrange(max(len(body[0]), 1))
    row = rng.randrange(len(body))
    if kind == 0:
        body = [cells[:column] + cells[column + 1 :] for cells in body]
    elif kind == 1:
        body = [cells[: column + 1] + cells[column:] for cells in body]
    elif kind == 2:
        body[0] = [*body[0][:column], rng.choice(WORDS), *body[0][column + 1 :]]
    elif kind == 3:
        body = body[:row] + body[row + 1 :]
    elif kind == 4:
        body = body[:row] + [body[row]] * rng.choice((2, 3, 50)) + body[row:]
    elif kind == 5:
        value = rng.choice(NUMBERS)  # the whole column
        body = [body[0], *([*cells[:column], value, *cells[column + 1 :]] for cells in body[1:])]
    elif kind == 6:
        factor = rng.choice((1e-9, 1e-6, 1e3, 1e6, 1e9, -1.0, 0.0, 1e300))
        body = [
            body[0],
            *(
                [*cells[:column], _times(cells[column : column + 1], factor), *cells[column + 1 :]]
                for cells in body[1:]
            ),
        ]
    else:
        body[row] = [*body[row], *[rng.choice(NUMBERS)] * rng.choice((1, 2, 5000))]
    if rng.random() < 0.1:
        rows[0] = [
            rng.choice(("# noise: ", "# units: ", "# kind: ", "# command_hold: ", "# quantum: ", "# : "))
            + rng.choice((*WORDS, *NUMBERS, "[" * 9999))
        ]
    return "\n".join(",".join(cells) for cells in rows[:first] + body)


def _times(cells: list[str], factor: float) -> str:
    try:
        return repr(float(cells[0]) * factor)
    except (ValueError, IndexError):
        return cells[0] if cells else ""


def change_json(text: str, rng: Random) -> str:
    """Replace, drop, repeat, rename or deeply nest a node of a JSON tree."""
    kind = rng.randrange(12)
    if kind == 0:
        depth = rng.choice((70, 900, 5000, 100_000))
        return rng.choice(("[" * depth + "]" * depth, '{"a":' * depth + "1" + "}" * depth, "[" * depth))
    if kind == 1:
        return text[:-1] + rng.choice((",", "}}", '"', "]", "nan", '"a":1}', "\x00"))
    if kind < 4:
        return change_numbers(text, rng)
    tree = change_tree(json.loads(text), rng)
    if kind == 4:
        tree = change_tree(tree, rng)
    return json.dumps(tree)


def change_tree(
    tree: Any, rng: Random, values: tuple[Any, ...] = VALUES, change: Callable[[Any, Random], Any] | None = None
) -> Any:
    """Change one node of nested lists and dictionaries, in place if possible; change: the caller's change of a leaf."""
    places = list(_places(tree))
    if not places or rng.random() < 0.03:
        return rng.choice(values)
    parent, key = rng.choice(places)
    kind = rng.randrange(8)
    if kind == 0:
        del parent[key]
    elif kind == 1 and isinstance(parent, dict):
        parent[rng.choice(WORDS)] = parent.pop(key)
    elif kind == 1:
        parent.insert(key, parent[key])
    elif kind == 2:
        parent[key] = [parent[key]] if rng.random() < 0.5 else {"x": parent[key]}
    elif kind == 3 and isinstance(parent[key], str) and parent[key]:
        parent[key] = change_words(parent[key], rng)
    elif change is not None and kind < 6:
        parent[key] = change(parent[key], rng)
    elif kind == 4:  # make a list longer or shorter
        value = parent[key]
        parent[key] = (
            value[:-1]
            if isinstance(value, list) and rng.random() < 0.5
            else value * 2
            if isinstance(value, (list, str))
            else [value] * 3
        )
    else:
        parent[key] = rng.choice(values)
    return tree


def _places(tree: Any):
    """Every (parent, key) below a tree."""
    level = [tree]
    while level:
        one = level.pop()
        for key in list(one) if isinstance(one, dict) else range(len(one)) if isinstance(one, list) else ():
            yield one, key
            level.append(one[key])


def change_xml(text: str, rng: Random) -> str:
    """Drop, repeat, nest or move elements; drop, rename or replace attributes."""
    tags = list(re.finditer(r"<[A-Za-z_][^<>]*>", text))
    if not tags:
        return text
    tag = rng.choice(tags)
    kind = rng.randrange(10)
    if kind == 0:  # drop or repeat its whole line
        start, stop = text.rfind("\n", 0, tag.start()) + 1, text.find("\n", tag.end())
        return (
            text[:start] + text[stop if stop > 0 else None :]
            if rng.random() < 0.5
            else text[:stop] + text[start:stop] + text[stop:]
        )
    if kind == 1:
        depth = rng.choice((30, 300, 3000, 50_000))
        return text[: tag.start()] + "<a>" * depth + "</a>" * depth + text[tag.start() :]
    if kind == 2:
        return text[: tag.start()] + text[tag.end() :]
    if kind == 3:
        return text[: tag.end()] + rng.choice(EXTRA_XML) + text[tag.end() :]
    if kind < 6:
        return change_numbers(text, rng)
    attributes = list(re.finditer(r'(\w+)="([^"]*)"', text))
    if not attributes:
        return text
    one = rng.choice(attributes)
    if kind == 6:
        return text[: one.start()] + text[one.end() :]
    if kind == 7:
        return text[: one.start(1)] + rng.choice(("x", "name", "value", "xyz", "")) + text[one.end(1) :]
    value = rng.choice((*NUMBERS, "0 0", "0 0 0", "1 1", "0 0 0 0", "1e308 0 0", "nan 0 0", "base", "upper", "fixed", "mesh", "floating", "planar", "continuous",
                        one[2] * 2, f"{one[2]} {one[2]}", "&lt;", "x" * 9999))  # fmt: skip
    return text[: one.start(2)] + value + text[one.end(2) :]


SHAPES = ('<box size="1 2"/>', '<box/>', '<box size="nan 1 1"/>', '<sphere radius="-1"/>', '<sphere/>', '<cylinder radius="1e308" length="0"/>', "",
          '<mesh filename="package://none/a.stl"/>', '<mesh filename=""/>', '<mesh filename="."/>', '<mesh filename="two.urdf"/>', '<capsule/>',
          '<box size="1 1 1"/><box size="1 1"/>')  # fmt: skip
EXTRA_XML = (
    *(f"<{kind}><geometry>{shape}</geometry></{kind}>" for shape in SHAPES for kind in ("visual", "collision")),
    '<mimic joint="elbow"/>', '<mimic joint="shoulder" multiplier="x"/>', "<mimic/>", "<axis/>", '<axis xyz="0 0 0"/>', "<limit/>", "<origin/>",
    "<inertial/>", '<link name="base"/>', '<link/>', '<joint/>', '<joint name="end" type="fixed"/>', '<dynamics damping="x"/>', "<!-- -->",
    '<!DOCTYPE a [<!ENTITY b "c">]>&b;', "<transmission/>", '<material name="m"><color rgba="1"/></material>', '<origin xyz="1" rpy="a b c"/>',
)  # fmt: skip
