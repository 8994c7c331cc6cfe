"""Export of the workbench as standalone files: the report, and the scene as an animation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from embodiedreamer_gym.diagnosis import compare, error_breakdown
from embodiedreamer_gym.diagnosis.report import write_report
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import atomic_file
from embodiedreamer_gym.workbench.player import Motion
from embodiedreamer_gym.workbench.scene import Scene
from embodiedreamer_gym.workbench.serve import place_camera, serve
from embodiedreamer_gym.workbench.session import Session

FRAME = 1 / 20  # s between two frames of the animation
LONGEST = 60.0  # s; longest animation


def save_page(session: Session, motion: Motion, times: float, folder: Path) -> Path:
    """Write index.html, the report, and scene.html, the motion shown with its ghost; returns the report's path.

    times: factor by which the differences of the ghost are magnified.
    Raises: EmbodieDreamerError when the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EmbodieDreamerError(f"{folder} cannot be written: {error.strerror or error}.") from error
    with atomic_file(folder / "scene.html") as part:
        part.write_text(scene_page(session, motion, times), encoding="utf-8")
    steps = [step for step in session.state.steps if step.model is not session.model]
    models = [*(step.model for step in steps), session.model]
    labels = [f"{k}: {label}" for k, (label, _) in enumerate(session.staircase)]
    return write_report(
        folder, comparison=compare(models, session.test, labels), diagnosis=session.diagnosis,
        breakdown=error_breakdown(session.model, session.test), recordings=session.test,
        links={f"The arm, measured and simulated: {motion.name}, differences drawn {times:g} times as large": "scene.html"},
    )  # fmt: skip


def scene_page(session: Session, motion: Motion, times: float) -> str:
    """A standalone page with the animated scene, which needs no server."""
    server = serve("127.0.0.1", 0)
    try:
        scene = Scene(server.scene, session.model)
        place_camera(server, scene.surface, motion.measured[0])
        drawn = motion.drawn(times)
        scene.trace(motion.measured, drawn)
        serializer = server.get_scene_serializer()
        for seconds in np.arange(0.0, min(float(motion.time[-1]), LONGEST), FRAME):
            at = motion.at(float(seconds))
            scene.show(motion.measured[at], None if drawn is None else drawn[at], motion.noises[at])
            serializer.insert_sleep(FRAME)
        return serializer.as_html()
    finally:
        server.stop()
