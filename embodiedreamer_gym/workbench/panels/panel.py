"""What the parts of the page share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from embodiedreamer_gym.workbench.actions import Actions
from embodiedreamer_gym.workbench.session import Session


class Panel:
    """A part of the page; `update` is called after every action, `settle` when nothing has been asked for a while.

    gui: a viser `GuiApi`, in the container in which the part belongs.
    """

    def __init__(self, gui: Any, session: Session, actions: Actions) -> None:
        self.gui, self.session, self.actions = gui, session, actions
        self.build()

    def build(self) -> None:
        """Add what is always there."""

    def update(self) -> None:
        """Show the session as it is now; quick."""

    def settle(self) -> None:
        """Show what takes longer."""

    def progress(self) -> None:
        """Show how far long work is; called from its thread."""

    def button(self, label: str, work: Callable[[], None], **more: Any) -> Any:
        """A button that does some work."""
        button = self.gui.add_button(label, **more)
        button.on_click(lambda _: work())
        return button

    def input(self, handle: Any, work: Callable[[Any], None]) -> Any:
        """An input whose value somebody at a page has changed; what the program sets itself does not count."""
        handle.on_update(lambda event: work(handle.value) if event.client is not None else None)
        return handle


def choose(handle: Any, options: tuple[str, ...], value: str) -> None:
    """Set a list's choices and its value, where they differ."""
    if tuple(handle.options) != options:
        handle.options = options
    if handle.value != value:
        handle.value = value
