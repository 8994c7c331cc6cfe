"""The page: a viser server on this machine with the scene, the panels and one session."""

from __future__ import annotations

import contextlib
import importlib
import io
import time
from typing import Any

import numpy as np

from embodiedreamer_gym.errors import EmbodieDreamerError, MissingExtraError
from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.actions import Actions
from embodiedreamer_gym.workbench.panels.panel import Panel
from embodiedreamer_gym.workbench.session import Session

HERE = "127.0.0.1"
BRAND = (31, 111, 178)


def load_viser() -> Any:
    """Import viser.

    Raises: MissingExtraError with the line that installs it.
    """
    try:
        return importlib.import_module("viser")
    except ImportError as error:
        raise MissingExtraError(
            "the workbench needs viser, which is not installed; run: pip install 'embodiedreamer-gym[workbench]'"
        ) from error


class Page:
    """The page of a session; host, port: where it is served (another port where this one is taken).

    words: what stands at the top, such as the question of a game.
    Raises: MissingExtraError without viser, EmbodieDreamerError where nothing can be served there.
    """

    def __init__(self, session: Session, host: str = HERE, port: int = 8080, words: str = "") -> None:
        viser = load_viser()
        from embodiedreamer_gym.workbench.panels.effect import EffectPanel
        from embodiedreamer_gym.workbench.panels.error import ErrorPanel, MapPanel
        from embodiedreamer_gym.workbench.panels.motion import MotionPanel
        from embodiedreamer_gym.workbench.panels.search import SearchPanel
        from embodiedreamer_gym.workbench.scene import Scene

        self.session = session
        self.server = _serve(viser, host, port)
        gui = self.server.gui
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, brand_color=BRAND)
        gui.set_panel_label("EmbodieDreamer workbench")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        self.actions = Actions(session, self.update, self.settle, self.progress, self.say)
        self._shown = 0.0
        self.scene = Scene(self.server.scene, session.model)
        self._look()
        left = gui.add_panel()
        left.dock_left()
        left.set_width(400)
        with left.add_tab("Motion"):
            self.motion = MotionPanel(gui, session, self.actions, self.scene, self.server)
        with left.add_tab("Where it fails"):
            where = MapPanel(gui, session, self.actions)
        if words:
            gui.add_html(html.sentence(words))
        self._said = gui.add_html("", visible=False)
        self.panels: list[Panel] = [self.motion, ErrorPanel(gui, session, self.actions), where]
        tabs = gui.add_tab_group()
        with tabs.add_tab("Try an effect"):
            self.panels.append(EffectPanel(gui, session, self.actions))
        with tabs.add_tab("Diagnose"):
            self.panels.append(SearchPanel(gui, session, self.actions))
        self.motion.player.refresh()
        self.actions.start()
        self.actions.call(lambda: None)

    @property
    def url(self) -> str:
        """Address of the page."""
        host = self.server.get_host()
        return f"http://{'127.0.0.1' if host == '0.0.0.0' else host}:{self.server.get_port()}"

    def update(self) -> None:
        """Show the session everywhere."""
        for panel in self.panels:
            panel.update()

    def settle(self) -> None:
        """Show what takes longer."""
        for panel in self.panels:
            panel.settle()

    def progress(self) -> None:
        """Show how far long work is, a few times a second."""
        now = time.monotonic()
        if now - self._shown > 0.2:
            self._shown = now
            for panel in self.panels:
                panel.progress()

    def say(self, text: str) -> None:
        """Show a sentence in every tab."""
        self._said.content, self._said.visible = html.sentence(text, strong=True), True
        for client in self.server.get_clients().values():
            client.add_notification("", text, auto_close_seconds=8.0)

    def close(self) -> None:
        """Stop serving."""
        self.motion.close()
        self.actions.close()
        self.server.stop()

    def _look(self) -> None:
        """The first look at the robot: from its front and side, all of it in the picture."""
        scene, surface = self.server.scene, self.scene.surface
        points = surface.points(self.session.recording.position[:1])[0]
        middle, size = 0.5 * (points.min(axis=0) + points.max(axis=0)), float(np.ptp(points, axis=0).max())
        camera = self.server.initial_camera
        camera.look_at, camera.position = tuple(middle), tuple(middle + size * np.array([1.25, -1.25, 0.75]))
        scene.world_axes.visible = False
        scene.configure_default_lights(cast_shadow=True)


def _serve(viser: Any, host: str, port: int) -> Any:
    """A server that offers no tunnel to the outside.

    Raises: EmbodieDreamerError where the address cannot be used.
    """
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host=host, port=port, verbose=False)
    except OSError as error:
        raise EmbodieDreamerError(f"no page can be served at {host}:{port}: {error.strerror or error}.") from error
    messages = importlib.import_module("viser._messages")
    server._websock_server.unregister_handler(messages.ShareUrlRequest)
    return server
