"""Diagnose: candidates as they come in, the verdict in words, what cannot be shown; put a candidate on; accept."""

from __future__ import annotations

from embodiedreamer_gym.io.tables import number
from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.panels.panel import Panel, choose

NONE = "none yet"


class SearchPanel(Panel):
    """The diagnosis and what becomes of it."""

    def build(self) -> None:
        """Add the buttons and places."""
        gui = self.gui
        self._button = self.button("diagnose", lambda: self.actions.do("diagnose"))
        self._stop = self.button("stop", self.actions.stop, visible=False)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._job = gui.add_html("", visible=False)
        self._verdict = gui.add_html("")
        self._candidates = gui.add_html("")
        self._choice = gui.add_dropdown("candidate", (NONE,), visible=False)
        self._put_on = self.button(
            "try this candidate", self._put, visible=False, hint="Adds it to the last kept model and fits all."
        )
        self._take = self.button("show the diagnosed model", lambda: self.actions.do("take"), visible=False)
        self._more = gui.add_html("")
        gui.add_divider()
        self._accept = self.button(
            f"accept: write {self.session.out.name}",
            lambda: self.actions.do("accept"),
            hint="Writes the current model and its history.",
        )
        self._accepted = gui.add_html("")

    def update(self) -> None:
        """Show the diagnosis."""
        found, session = self.session.diagnosis, self.session
        self.progress()
        ready = found is not None and session.job is None
        self._choice.visible = self._put_on.visible = self._take.visible = ready
        if found is not None:
            self._verdict.content = html.sentence(found.sentence, strong=True) + "".join(
                map(html.sentence, found.notes)
            )
            rows = [
                [r.effect.replace("_", " "), number(r.held_out_chi2), f"{r.gain:.2f} ± {1.96 * r.gain_error:.2f}"]
                for r in found.ranking
            ]
            if rows:
                self._candidates.content = html.table(("with the effect", "held-out chi²/n", "gain (log)"), rows)
                names = tuple(r.effect for r in found.ranking)
                choose(self._choice, names, self._choice.value if self._choice.value in names else names[0])
            self._more.content = _details(found)
        if session.accepted is not None:
            self._accepted.content = html.sentence(
                f"Written: {session.accepted} and {session.accepted.stem}.history.json."
            )

    def progress(self) -> None:
        """Show the candidates as they come in."""
        status = self.actions.status
        own = status is not None and status.name == "diagnose"
        self._bar.visible = self._job.visible = self._stop.visible = own
        self._button.disabled = status is not None
        if status is not None and own:
            self._bar.value = 100.0 * status.share
            self._job.content = html.sentence(status.text)
            rows = [[name.replace("_", " "), error] for name, error in status.candidates.items()]
            if rows:
                self._candidates.content = html.table(("candidate", "held-out error"), rows)

    def _put(self) -> None:
        if self._choice.value != NONE:
            self.actions.do("put_on", effect=self._choice.value)


def _details(found) -> str:
    """Parameters with intervals, and what these recordings cannot show."""
    from embodiedreamer_gym.diagnosis.report.sentences import unseen_sentences  # brings matplotlib

    table = ""
    for name in found.parameters:
        rows = found.model.parameters().of_effect(name).rows
        table += html.sentence(f"{name.replace('_', ' ')}, with 95 % intervals:") + html.values(rows)
    return table + "".join(
        map(html.sentence, ("What these recordings cannot show:", *unseen_sentences(found.as_dict())))
    )
