"""Source of modules with user-defined policies that are faulty in many ways."""

from __future__ import annotations

from random import Random

SOURCE = """import numpy as np


class Mine:
    action_size = {size}
    chunk = {chunk}
    cameras = {cameras}
    asked = 0

    def reset(self):
        {reset}

    def __call__(self, batch):
        self.asked += 1
        if self.asked > 2:
            raise RuntimeError("asked often enough")
        {body}
        return {actions}


def make({arguments}):
    {make}
    return {made}
"""
VALUES = (
    "14",
    "14",
    "14",
    "0",
    "-1",
    "None",
    "'14'",
    "14.0",
    "10**400",
    "float('nan')",
    "[14]",
    "True",
    "10**9",
    "object()",
)
PARTS = {
    "size": VALUES,
    "chunk": ("4", "4", "4", "30", "1", *VALUES[3:]),
    "cameras": ("('head',)", "('head',)", "'head'", "()", "None", "5", "('none',)", "[1]", "('head', 'head')", "{'head': 1}"),
    "reset": ("pass", "pass", "pass", "1 / 0", "return 5"),
    "body": ("pass", "pass", "pass", "1 / 0", "raise StopIteration", "raise MemoryError", "batch.clear()", "batch['agent_pos'][:] = np.nan", "self.chunk = -5", "batch['pixels']['none']", "assert False"),
    "actions": ("np.zeros((1, 4, 14), np.float32)", "np.zeros((1, 4, 14))", "np.full((1, 4, 14), np.nan)", "np.full((1, 4, 14), np.inf)",
                "np.zeros((4, 14))", "np.zeros((1, 4, 14), complex)", "None", "'go'", "[[['x'] * 14] * 4]", "np.zeros((2, 4, 14))", "np.zeros((1, 0, 14))",
                "np.full((1, 4, 14), 1e300)", "np.empty((1, 4, 14), object)", "{'a': 1}", "iter(())", "np.zeros((1, 4, 14)).tolist()", "self",
                "np.full((1, 4, 14), 10**400)", "[[[10**400] * 14] * 4]"),
    "arguments": ("", "", "", "", "x", "*args", "x=1"),
    "make": ("pass", "pass", "pass", "pass", "1 / 0", "raise ImportError('none')", "import none"),
    "made": ("Mine()", "Mine()", "Mine()", "Mine()", "Mine()", "Mine()", "Mine", "None", "5", "lambda batch: 0", "'Mine'", "[]"),
}  # fmt: skip
BROKEN = ("def make(:", "1 / 0", "", "import none", "make = 5", "chunk = 4", "make = make", "\x00", "from mine import make",
          "def make():\n    return make()", "raise KeyError", "\ufeff\ufeff", "# -*- coding: none -*-", "class make: action_size = 14; chunk = 4")  # fmt: skip


def source(rng: Random) -> str:
    """Source of a module `mine` with a function `make`."""
    if rng.random() < 0.15:
        return rng.choice(BROKEN)
    parts = {name: choices[0] for name, choices in PARTS.items()}
    for name in rng.sample(sorted(PARTS), rng.choice((1, 1, 1, 2, 3))):
        parts[name] = rng.choice(PARTS[name])
    return SOURCE.format(**parts)
