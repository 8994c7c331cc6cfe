"""The page: a viser server on this machine with the scene, the panels and one session."""

from __future__ import annotations

import time

from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.actions import Actions
from embodiedreamer_gym.workbench.panels.effect import EffectPanel
from embodiedreamer_gym.workbench.panels.error import ErrorPanel, MapPanel
from embodiedreamer_gym.workbench.panels.game import GamePanel
from embodiedreamer_gym.workbench.panels.motion import MotionPanel
from embodiedreamer_gym.workbench.panels.next_motion import NextMotionPanel
from embodiedreamer_gym.workbench.panels.panel import Panel
from embodiedreamer_gym.workbench.panels.search import SearchPanel
from embodiedreamer_gym.workbench.panels.share import SharePanel
from embodiedreamer_gym.workbench.scene import Scene
from embodiedreamer_gym.workbench.serve import place_camera, serve
from embodiedreamer_gym.workbench.session import Session

HERE = "127.0.0.1"
BRAND = (31, 111, 178)
SAID = 8.0  # s; shortest time that a sentence is shown


class Page:
    """The page of a session; host, port: address to serve it at (the next free port if this one is taken).

    words: text at the top of the page; game: ask the user for the hidden effect of the demo.
    Raises: MissingExtraError without viser, EmbodieDreamerError where no page can be served at the address.
    """

    def __init__(
        self, session: Session, words: str = "", game: bool = False, host: str = HERE, port: int = 8080
    ) -> None:
        self.session = session
        self.server = serve(host, port)
        gui = self.server.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, brand_color=BRAND)
        gui.set_panel_label("EmbodieDreamer workbench")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        self.actions = Actions(session, self.update, self.settle, self.progress, self.say)
        self._shown, self._said_at, self._closed = 0.0, 0.0, False
        self.scene = Scene(self.server.scene, session.model)
        place_camera(self.server, self.scene.surface, session.recording.position[0])
        left = gui.add_panel()
        left.dock_left()
        left.set_width(430)
        with left.add_tab("Motion"):
            self.motion = MotionPanel(gui, session, self.actions, self.scene, self.server)
        with left.add_tab("Where it fails"):
            where = MapPanel(gui, session, self.actions)
        gui.add_html(html.LOST)
        if words:
            gui.add_html(html.sentence(words))
        self._said = gui.add_html("", visible=False)
        games = [GamePanel(gui, session, self.actions)] if game else []
        self.panels: list[Panel] = [
            ErrorPanel(gui, session, self.actions),
            *games,
            self.motion,
            where,
        ]  # the error panel comes first
        tabs = gui.add_tab_group()
        with tabs.add_tab("Try an effect"):
            self.panels.append(EffectPanel(gui, session, self.actions))
        with tabs.add_tab("Diagnose"):
            self.panels.append(SearchPanel(gui, session, self.actions))
        with tabs.add_tab("Next motion"):
            self.panels.append(NextMotionPanel(self.motion, gui, session, self.actions))
        with tabs.add_tab("Share"):
            self.share = SharePanel(self.motion, gui, session, self.actions)
            self.panels.append(self.share)
        self.motion.player.refresh()
        self.actions.start()
        self.actions.call(lambda: None)

    @property
    def url(self) -> str:
        """Address of the page."""
        host = self.server.get_host()
        return f"http://{'127.0.0.1' if host == '0.0.0.0' else host}:{self.server.get_port()}"

    def update(self) -> None:
        """Update all panels from the session."""
        if self._said.visible and time.monotonic() - self._said_at > SAID:
            self._said.visible = False
        for panel in self.panels:
            panel.update()

    def settle(self) -> None:
        """Update the slow parts of all panels."""
        for panel in self.panels:
            panel.settle()

    def progress(self) -> None:
        """Show the progress of long work, at most five times a second."""
        now = time.monotonic()
        if now - self._shown > 0.2:
            self._shown = now
            for panel in self.panels:
                panel.progress()

    def say(self, text: str) -> None:
        """Show a sentence in every tab."""
        self._said.content, self._said.visible = html.sentence(text, strong=True), True
        self._said_at = time.monotonic()
        for client in self.server.get_clients().values():
            client.add_notification("", text, auto_close_seconds=SAID)

    def close(self) -> None:
        """Stop serving; every tab says that the workbench does not answer."""
        if self._closed:
            return
        self._closed = True
        self.motion.close()
        self.share.close()
        self.actions.close()
        self.server.stop()
