"""The next motion: the one that distinguishes two effects, played in the scene before any robot moves."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.charts import Chart, line, mark
from embodiedreamer_gym.workbench.panels.motion import MotionPanel
from embodiedreamer_gym.workbench.panels.panel import Panel

TABLES = ("no table", "a table at height")
FILE = "next.csv"


class NextMotionPanel(Panel):
    """Two effects, the motion that is proposed, its clearance, and its file."""

    def __init__(self, motion: MotionPanel, *arguments) -> None:
        self._motion = motion
        self._seen = self._asked = None
        super().__init__(*arguments)

    def build(self) -> None:
        """Add the choices and places."""
        gui, names = self.gui, tuple(self.session.model.catalogue)
        gui.add_html(html.sentence("Propose a motion that distinguishes two effects:"))
        self._first = gui.add_dropdown(
            "effect", names, initial_value="coulomb_friction" if "coulomb_friction" in names else names[0]
        )
        self._second = gui.add_dropdown(
            "or", names, initial_value="stribeck_friction" if "stribeck_friction" in names else names[-1]
        )
        self._table = gui.add_dropdown("table", TABLES)
        self._height = gui.add_number("height [m]", 0.0, step=0.01, hint="In the frame of the URDF's root.")
        self._propose = self.button("propose a motion", self._ask)
        self._stop = self.button("stop", self.actions.stop, visible=False)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._words = gui.add_html("")
        self._chart = gui.add_folder("clearance", visible=False)
        with self._chart:
            series = [line("least distance", "#1f6fb2"), mark("closest", "#cc2924")]
            self._clearance = Chart(gui, series, "mm", [], 170)
        self._play = self.button("play it", self._show, visible=False)
        self._back = self.button("back to the recording", lambda: self.actions.call(lambda: None), visible=False)
        self._save = self.button(f"write {FILE}", self._write, visible=False)

    def update(self) -> None:
        """Show the proposal, and after a diagnosis the two effects it asks about."""
        session = self.session
        question = session.diagnosis.question() if session.diagnosis else None
        if question and question != self._asked:
            self._asked = question
            self._first.value, self._second.value = question
        self.progress()
        found = session.rehearsal
        self._play.visible = self._back.visible = self._save.visible = self._chart.visible = found is not None
        if found is not None and found is not self._seen:
            self._seen = found
            self._words.content = html.sentence(" ".join(str(found.proposal).split("\n\n")[0].splitlines()) + ".")
            self._clearance.draw(found.time, 1e3 * found.clearance)
            self._clearance.point(int(np.argmin(found.clearance)), 0)
            self._show()

    def progress(self) -> None:
        """Show how far the search is."""
        status = self.actions.status
        own = status is not None and status.name == "propose"
        self._bar.visible = self._stop.visible = own
        self._propose.disabled = status is not None
        if status is not None and own:
            self._bar.value = 100.0 * status.share
            self._words.content = html.sentence(status.text)

    def _ask(self) -> None:
        table = None if self._table.value == TABLES[0] else float(self._height.value)
        self.actions.do("propose", first=self._first.value, second=self._second.value, table=table)

    def _show(self) -> None:
        if self.session.rehearsal is not None:
            self._motion.play(self.session.rehearsal.motion)

    def _write(self) -> None:
        found = self.session.rehearsal
        if found is not None:
            path = self.session.out.with_name(FILE)
            self.actions.call(lambda: found.proposal.save(path))
            self.actions.note(f"Written: {path}. Drive slowly to its first pose before it runs on the robot.")
