"""The game: the demo's arm has a hidden effect; find it, then look at the answer."""

from __future__ import annotations

import json

from embodiedreamer_gym.demo import TRUTH
from embodiedreamer_gym.io.tables import milli, number
from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.panels.panel import Panel

QUESTION = (
    "A game. This arm was recorded; its model lacks one physical effect, and its servo gains are not exact. "
    "Fit, look where it fails, try effects until the error is near the noise, and keep what helps. "
    "Then let the diagnosis show how, or look at the answer."
)


class GamePanel(Panel):
    """The question, the score and the answer."""

    def build(self) -> None:
        """Add the question."""
        with self.gui.add_folder("find the hidden effect"):
            self.gui.add_html(html.sentence(QUESTION))
            self._score = self.gui.add_html("")
            self.button("show the answer", self._reveal)
            self._answer = self.gui.add_html("", visible=False)

    def update(self) -> None:
        """Show the score: the held-out error and how many actions it took."""
        session = self.session
        tries = sum(entry["action"] in ("fit", "put_on", "set_effect") for entry in session.log)
        error, noise = milli(session.error), milli(float(session.measure.signals.sigma.mean()))
        self._score.content = html.sentence(f"{error} after {tries} tries; the noise is {noise}.", strong=True)

    def _reveal(self) -> None:
        truth = json.loads(TRUTH.read_text(encoding="utf-8"))
        kept = [effect.name for effect in self.session.model.effects]
        words = "You have it on." if truth["effect"] in kept else "It is not on the model yet."
        rows = [
            [name.replace("_", " "), joint, number(value)]
            for name, values in truth["values"].items()
            for joint, value in values.items()
        ]
        text = html.sentence(f"The hidden effect is {truth['effect'].replace('_', ' ')}. {words}", strong=True)
        self._answer.content = text + html.table(("parameter", "at", "true value"), rows)
        self._answer.visible = True
