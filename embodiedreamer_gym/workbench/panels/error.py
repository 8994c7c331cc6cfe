"""The held-out error of the model on show: as a number, as a staircase, and joint by regime."""

from __future__ import annotations

from embodiedreamer_gym.diagnosis.regimes import REGIME_HEADS, REGIMES
from embodiedreamer_gym.io.tables import milli
from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.panels.panel import Panel

SHORTER = {"reversal": "rev.", "loaded": "load"}  # so that all buttons of a joint stand in one line


class ErrorPanel(Panel):
    """The error of the model on show beside the last one and the noise, and the staircase."""

    def build(self) -> None:
        """Add the places."""
        self._bars = self.gui.add_html(html.sentence("simulating …"))

    def update(self) -> None:
        """Show the errors."""
        signals = self.session.measure.signals
        noise = float(self.session.measure.noise(self.session.model).mean())
        self._bars.content = html.bars(self.session.staircase, noise, signals.unit or "rad")


class MapPanel(Panel):
    """The error by joint and regime; a button for each cell jumps to where it is worst."""

    def build(self) -> None:
        """Add the table and the buttons."""
        self._table = self.gui.add_html(html.sentence("simulating …"))
        self.gui.add_html(html.sentence("Jump to the instant at which a joint is worst in a regime:"))
        heads = [SHORTER.get(head, head) for head in REGIME_HEADS]
        self._at = dict(zip(heads, ("all", *REGIMES), strict=True))
        for joint in self.session.model.joints:
            group = self.gui.add_button_group(joint, tuple(heads))
            group.on_click(lambda event, joint=joint: self._jump(joint, event.target.value))
        self._shown = None

    def settle(self) -> None:
        """Show the table of the model on show."""
        if self.session.model is not self._shown:
            self._shown = self.session.model
            comparison = self.session.measure.comparison(self._shown)
            end = comparison.end_effector_mm[0]
            text = f"Held-out error {milli(float(comparison.error[0]), comparison.unit)}, chi²/n by joint and regime; 1 is the noise."
            if end == end:
                text += f" At the end effector {end:.2f} mm."
            self._table.content = html.sentence(text) + html.error_map(comparison.joints, comparison.grid())

    def _jump(self, joint: str, head: str) -> None:
        if head in self._at:
            self.actions.do("jump", joint=joint, regime=self._at[head])
