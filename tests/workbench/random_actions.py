"""Actions such as somebody at the page might ask for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from embodiedreamer_gym.workbench.session import Session


def random_actions(session: Session, rng: np.random.Generator, count: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Actions such as somebody at the page might ask for, sensible or not."""
    names, joints = list(session.model.catalogue), list(session.model.joints)
    for _ in range(count):
        kind = rng.choice(["set_effect", "set_size", "set_joints", "undo", "redo", "keep", "choose_joint", "choose_recording", "choose_time"],
                          p=[0.1, 0.4, 0.1, 0.15, 0.1, 0.02, 0.05, 0.05, 0.03])  # fmt: skip
        if kind == "set_effect":
            yield kind, {"name": str(rng.choice(["", *names]))}
        elif kind == "set_size":
            groups = [str(r.key.group) for r in session.model.parameters() if r.key.effect] or ["nothing"]
            place = {} if rng.random() < 0.5 else {"place": str(rng.choice(joints))}
            yield kind, {"parameter": str(rng.choice(groups)), "size": float(rng.uniform(-1, 1)), **place}
        elif kind == "set_joints":
            yield kind, {"joints": [j for j in joints if rng.random() < 0.6]}
        elif kind == "choose_joint":
            yield kind, {"joint": str(rng.choice(joints))}
        elif kind == "choose_recording":
            yield kind, {"name": str(rng.choice(session.names))}
        elif kind == "choose_time":
            yield kind, {"seconds": float(rng.uniform(-1, 9))}
        else:
            yield str(kind), {}
