"""Try an effect: choose it, its joints and its size, fit, keep, undo and redo."""

from __future__ import annotations

from typing import Any

from embodiedreamer_gym.effects import find_effect
from embodiedreamer_gym.workbench import html, trial
from embodiedreamer_gym.workbench.panels.panel import Panel, choose

NONE = "none"
ALL = "all chosen joints"
ASK = (
    "Choose an effect and move its sliders: the error is computed again. 'fit' fits all parameters of the model from there, "
    "'keep' adds the model to the chart of held-out errors above."
)


class EffectPanel(Panel):
    """Sliders of the effect that is being tried."""

    def build(self) -> None:
        """Add what is always there."""
        gui, do = self.gui, self.actions.do
        names = (NONE, *self.session.model.catalogue)
        self._effect = self.input(
            gui.add_dropdown("effect", names), lambda name: do("set_effect", name="" if name == NONE else name)
        )
        self._words = gui.add_html(html.sentence(ASK))
        self._place = self.input(gui.add_dropdown("slider for", (ALL,)), lambda _: self._redraw())
        self._joints: dict[str, Any] = {}
        self._folder = gui.add_folder("joints", expand_by_default=False, visible=False)
        with self._folder:
            for joint in self.session.model.joints:
                box = gui.add_checkbox(joint, True)
                self._joints[joint] = self.input(box, lambda on, joint=joint: do("set_joint", joint=joint, on=on))
        self._sliders_folder = gui.add_folder("size (0: off or typical, ±1: ends of its range)", visible=False)
        self._sliders: dict[str, Any] = {}
        self._buttons = gui.add_button_group("model", ("fit", "keep", "undo", "redo"))
        self._buttons.on_click(lambda event: self._press(event.target.value))
        self._stop = self.button("stop", self.actions.stop, visible=False)
        self._job = gui.add_html("", visible=False)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._values = gui.add_html("")
        self._built: tuple = ()

    def update(self) -> None:
        """Show the effect, its joints and its values."""
        state = self.session.state
        choose(self._effect, tuple(self._effect.options), state.effect or NONE)
        self._folder.visible = self._sliders_folder.visible = self._place.visible = bool(state.effect)
        for joint, box in self._joints.items():
            if box.value != (joint in state.joints):
                box.value = joint in state.joints
        rows = self._rows()
        places = tuple(dict.fromkeys(row.key.place for row in rows))
        value = self._place.value if self._place.value in places else ALL
        choose(self._place, (ALL, *places), value)
        self._build_sliders()
        self._redraw()
        text = ASK
        if state.effect:
            kind = find_effect(state.effect, self.session.model.catalogue)
            text = f"{kind.symptom[:1].upper()}{kind.symptom[1:]}. It shows in {kind.reveals}."
        self._words.content = html.sentence(text)
        self._show_job()

    def progress(self) -> None:
        """Show how far a fit is."""
        self._show_job()

    def _show_job(self) -> None:
        status = self.actions.status
        self._stop.visible = self._bar.visible = self._job.visible = status is not None
        if status is not None:
            self._job.content = html.sentence(f"{status.name}: {status.text}")
            self._bar.value = 100.0 * status.share

    def _rows(self):
        state = self.session.state
        return list(self.session.model.parameters().of_effect(state.effect)) if state.effect else []

    def _build_sliders(self) -> None:
        """One slider for each parameter of the effect."""
        groups = {str(row.key.group): row for row in self._rows()}
        wanted = (self.session.state.effect, tuple(groups))
        if wanted == self._built:
            return
        self._built = wanted
        for slider in self._sliders.values():
            slider.remove()
        with self._sliders_folder:
            self._sliders = {}
            for group, row in groups.items():
                low, high = trial.reach(row)
                slider = self.gui.add_slider(row.key.parameter.replace("_", " "), low, high, 0.005, 0.0)
                self._sliders[group] = self.input(slider, lambda size, group=group: self._move(group, size))

    def _redraw(self) -> None:
        """Put the sliders where the values are."""
        rows, place = self._rows(), self._place.value
        for group, slider in self._sliders.items():
            own = [r for r in rows if str(r.key.group) == group and place in (ALL, r.key.place)]
            if own:
                size = round(trial.size_of(max(own, key=lambda r: abs(trial.size_of(r)))), 3)
                if abs(slider.value - size) > 2e-3:
                    slider.value = size
        self._values.content = html.values(rows)

    def _move(self, group: str, size: float) -> None:
        place = "" if self._place.value == ALL else self._place.value
        self.actions.do("set_size", parameter=group, size=size, place=place)

    def _press(self, what: str) -> None:
        if what in ("fit", "keep", "undo", "redo"):
            self.actions.do(what)
