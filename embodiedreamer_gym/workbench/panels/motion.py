"""The recording on show: play, pause, step, scrub, speed; charts of one joint; the arms in the scene."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from embodiedreamer_gym.io.tables import MILLI
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.workbench import html
from embodiedreamer_gym.workbench.actions import Actions
from embodiedreamer_gym.workbench.charts import error_chart, motion_chart
from embodiedreamer_gym.workbench.panels.panel import Panel, choose
from embodiedreamer_gym.workbench.player import Motion, Player
from embodiedreamer_gym.workbench.scene import Scene
from embodiedreamer_gym.workbench.session import Session

TIMES = ("1", "2", "5", "10", "20")  # as large as which differences may be drawn
VISIBLE = 0.12  # of the robot's size: about how far apart the ends are drawn at most
SLOW = 0.2  # s between two changes of slider and marks while it plays
SOLID = "Solid: measured arm. A link is grey if the error of its joint is at the noise, amber above it, red at 20 times the noise. "
BLUE = "Blue: simulated arm, its difference enlarged {:g} times."
NO_GHOST = "These logs have no commands. The measured effort is compared with the effort that the model needs for the measured motion; there is no simulated arm."
PROPOSED = "The proposed motion. Solid: the commands. Blue: the motion that the model predicts."


class MotionPanel(Panel):
    """Playback and charts; server: for grouping messages."""

    def __init__(self, gui: Any, session: Session, actions: Actions, scene: Scene, server: Any) -> None:
        self._scene, self._server = scene, server
        self._motion = _still(session)
        self._player = Player(self._show)
        self._seen: tuple = ()
        self._slow, self._times = 0.0, 0.0
        self.source = "recording"  # or "proposal"
        super().__init__(gui, session, actions)

    def build(self) -> None:
        """Add the controls."""
        gui, session = self.gui, self.session
        self._recording = self.input(
            gui.add_dropdown("recording", session.names), lambda name: self.actions.do("choose_recording", name=name)
        )
        self._joint = self.input(
            gui.add_dropdown("joint", session.model.joints), lambda name: self.actions.do("choose_joint", joint=name)
        )
        self._play = gui.add_button_group("playback", ("play", "pause", "step back", "step"))
        self._play.on_click(lambda event: self._control(event.target.value))
        self._time = self.input(gui.add_slider("time [s]", 0.0, 1.0, 0.001, 0.0), self._scrub)
        self._speed = self.input(
            gui.add_dropdown("speed", ("0.1", "0.25", "0.5", "1", "2"), initial_value="1"), self._set_speed
        )
        self._loop = self.input(gui.add_checkbox("loop", True), self._set_loop)
        hint = "Multiplies the distance between the simulated and the measured arm."
        self._exaggerate = self.input(
            gui.add_dropdown("enlarge error", TIMES, initial_value="1", hint=hint), self._set_times
        )
        self._words = gui.add_html("")
        self._error, self._signals = error_chart(gui), motion_chart(gui)
        cameras = sorted({name for r in session.recordings for name in r.frames})
        self._images = {
            name: gui.add_image(np.full((4, 6, 3), 240, np.uint8), label=name, visible=False) for name in cameras
        }
        self._broken: set[tuple[Recording, str]] = set()
        self._player.start()

    @property
    def player(self) -> Player:
        """The clock."""
        return self._player

    @property
    def motion(self) -> Motion:
        """The recording on show, whatever is played."""
        return self._motion if self.source == "recording" else _motion(self.session)

    @property
    def times(self) -> float:
        """How many times as large differences are drawn."""
        return self._times

    def close(self) -> None:
        """Stop the clock."""
        self._player.close()

    def update(self) -> None:
        """Show the recording, joint, instant and model of the session."""
        session = self.session
        choose(self._recording, session.names, session.names[session.recordings.index(session.recording)])
        choose(self._joint, session.model.joints, session.joint)
        seen = (session.recording, session.model, session.before, session.joint)
        if seen != self._seen or self.source == "proposal":
            self.source, self._seen = "recording", seen
            self._motion = _motion(session)
            self._player.duration = float(self._motion.time[-1])
            self._time.max = round(self._player.duration, 3)
            if not self._times:
                self._times = self._visible()
                self._exaggerate.value = f"{self._times:.0f}"
            self._draw()
        if abs(session.time - self._asked) > 1e-9 or session.recording is not self._asked_of:
            self._asked, self._asked_of = session.time, session.recording
            self._player.playing = False
            self._player.go(session.time)
        self._slow = 0.0
        self._explain()
        self._player.refresh()

    _asked, _asked_of = 0.0, None

    def play(self, motion: Motion) -> None:
        """Play another motion, such as one that is proposed, with differences as they are."""
        self.source, self._motion = "proposal", motion
        self._player.duration = float(motion.time[-1])
        self._time.max = round(self._player.duration, 3)
        self._scene.trace(motion.measured, motion.simulated)
        self._player.seconds, self._player.playing = 0.0, True
        self._explain()
        self._player.refresh()

    def _explain(self) -> None:
        """Say which arm is which."""
        text = PROPOSED
        if self.source == "recording":
            text = NO_GHOST if self.session.measure.signals.by_effort else SOLID + BLUE.format(self._times)
        self._words.content = html.sentence(text)

    def _visible(self) -> float:
        """How much larger than they are differences have to be drawn to be seen."""
        if self._motion.simulated is None:
            return 1.0
        apart = self._scene.tips(self._motion.simulated) - self._scene.tips(self._motion.measured)
        wanted = VISIBLE * self._scene.size / max(float(np.linalg.norm(apart, axis=-1).max()), 1e-9)
        return max([float(t) for t in TIMES if float(t) <= wanted], default=1.0)

    def _draw(self) -> None:
        """Draw the charts and the paths."""
        session, motion, measure = self.session, self._motion, self.session.measure
        j = session.model.joints.index(session.joint)
        noise = 2e3 * measure.noise(session.model)[j] * np.ones(len(motion.time))
        now = measure.errors(session.model, session.recording)
        before = None if session.before is session.model else measure.errors(session.before, session.recording)
        drawn = [None if error is None else 1e3 * error[:, j] for error in (before, now)]
        self._error.draw(motion.time, noise, -noise, *drawn, unit=f"error [{MILLI[measure.unit(session.model, j)]}]")
        command = session.recording.command
        simulated = None if motion.simulated is None else motion.simulated[:, j]
        self._signals.draw(
            motion.time,
            None if command is None else command[:, j],
            motion.measured[:, j],
            simulated,
            unit=session.model.units[j],
        )
        self._scene.trace(motion.measured, motion.drawn(self._times))

    def _show(self, seconds: float) -> None:
        """Place the arms at an instant; called from the player's thread."""
        motion = self._motion
        at = motion.at(seconds)
        drawn = motion.drawn(self._times if self.source == "recording" else 1.0)
        with self._server.atomic():
            self._scene.show(motion.measured[at], None if drawn is None else drawn[at], motion.noises[at])
        now = time.monotonic()
        if now - self._slow > SLOW or not self._player.playing:
            self._slow = now
            self._time.value = round(min(seconds, self._time.max), 3)
            if self.source == "recording":
                self._error.point(at, 3)
                self._signals.point(at, 1)
                self._frames(at)

    def _frames(self, at: int) -> None:
        recording = self.session.recording
        for name, image in self._images.items():
            shown = name in recording.frames and (recording, name) not in self._broken
            if shown and not self.actions.attempt(
                lambda image=image, name=name: _draw_frame(image, recording, name, at)
            ):
                self._broken.add((recording, name))
                shown = False
            image.visible = shown

    def _control(self, what: str) -> None:
        player = self._player
        player.playing = what == "play"
        if what == "play" and player.seconds >= player.duration:
            player.seconds = 0.0
        if what.startswith("step"):
            at = self._motion.at(player.seconds) + (1 if what == "step" else -1)
            player.seconds = float(self._motion.time[int(np.clip(at, 0, len(self._motion.time) - 1))])
        player.refresh()

    def _scrub(self, seconds: float) -> None:
        self._player.playing = False
        self._player.go(seconds)

    def _set_speed(self, text: str) -> None:
        self._player.speed = float(text)

    def _set_loop(self, loop: bool) -> None:
        self._player.loop = loop

    def _set_times(self, text: str) -> None:
        self._times = float(text)
        if self.source == "recording":
            self._scene.trace(self._motion.measured, self._motion.drawn(self._times))
        self._explain()
        self._player.refresh()


def _still(session: Session) -> Motion:
    """The first recording without any simulation."""
    recording = session.recording
    nothing = np.zeros(recording.position.shape)
    return Motion(recording.name, recording.time - recording.time[0], recording.position, None, nothing)


def _motion(session: Session) -> Motion:
    """The session's recording under its model."""
    recording, measure = session.recording, session.measure
    run = measure.shown(session.model, recording)
    errors = measure.errors(session.model, recording)
    noises = (
        np.zeros(recording.position.shape)
        if errors is None
        else np.abs(np.nan_to_num(errors)) / measure.noise(session.model)
    )
    simulated = None if run is None else run.position
    return Motion(recording.name, recording.time - recording.time[0], recording.position, simulated, noises)


def _draw_frame(image: Any, recording: Recording, camera: str, at: int) -> None:
    image.image = recording.frames[camera][at]
