"""Save what is on show as pages that open offline; run the accepted model in an environment."""

from __future__ import annotations

import threading

import numpy as np

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.panels.motion import MotionPanel
from embodiedreamer_gym.workbench.panels.panel import Panel

FOLDER = "workbench_report"
TASK = "PutCupOnMat"
STEPS = 300


class SharePanel(Panel):
    """Buttons that write pages, and that open an environment for models of an ALOHA."""

    def __init__(self, motion: MotionPanel, *arguments) -> None:
        self._motion = motion
        self._running = threading.Event()
        self._checked, self._aloha = None, False
        super().__init__(*arguments)

    def build(self) -> None:
        """Add the buttons."""
        folder = self.session.out.with_name(FOLDER)
        self._save = self.button(f"save as {FOLDER}/index.html", lambda: self.actions.call(self._write))
        self._saved = self.gui.add_html(
            html.sentence(f"Report and animated scene, in {folder}; they open without a server.")
        )
        self._open = self.button("open in an environment", self._start, visible=False)
        self._close = self.button("close the environment", self._running.clear, visible=False)
        self._picture = self.gui.add_image(np.full((3, 4, 3), 240, np.uint8), label=TASK, visible=False)

    def update(self) -> None:
        """Offer the environment once a model of an ALOHA has been accepted."""
        if self.session.accepted != self._checked:
            self._checked, self._aloha = self.session.accepted, self._is_aloha()
        self._open.visible = self._aloha and not self._running.is_set()

    def close(self) -> None:
        """End the environment."""
        self._running.clear()

    def _is_aloha(self) -> bool:
        from embodiedreamer_gym.envs.robots import load_robot

        try:
            return self.session.accepted is not None and bool(load_robot(self.session.accepted))
        except ModelError:
            return False

    def _write(self) -> None:
        from embodiedreamer_gym.workbench.share import (
            save_page,  # brings matplotlib, which the first picture need not wait for
        )

        self._saved.content = html.sentence("writing …")
        try:
            path = save_page(self.session, self._motion.motion, self._motion.times, self.session.out.with_name(FOLDER))
        except Exception:
            self._saved.content = html.sentence("Nothing was written.")
            raise
        self._saved.content = html.sentence(f"Written: {path} and scene.html beside it.")

    def _start(self) -> None:
        if not self._running.is_set():
            self._running.set()
            self._open.visible, self._close.visible, self._picture.visible = False, True, True
            threading.Thread(target=self._run, name="environment", daemon=True).start()

    def _run(self) -> None:
        try:
            self.actions.attempt(self._play_task)
        finally:
            self._running.clear()
            self._close.visible = False
            self.update()

    def _play_task(self) -> None:
        """Let the scripted expert do the task with the accepted model, and show the head camera."""
        from embodiedreamer_gym.envs.aloha import AlohaEnv
        from embodiedreamer_gym.envs.experts import ScriptedExpert

        env = AlohaEnv(TASK, robot=str(self.session.accepted), obs_type="state", render_mode="rgb_array")
        try:
            env.reset(seed=0)
            expert = ScriptedExpert(env)
            for _ in range(STEPS):
                if not self._running.is_set():
                    break
                env.step(expert.act())
                picture = env.render()
                if picture is not None:
                    self._picture.image = picture
        finally:
            env.close()
