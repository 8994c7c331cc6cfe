"""Play a motion in real time: measured and simulated joint positions, at a chosen speed, once or in a loop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

FRAME = 1 / 30  # s between two frames


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion to play: times (T,) s from zero, measured and simulated positions (T, n), errors in noises (T, n)."""

    name: str
    time: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray | None
    noises: np.ndarray

    def at(self, seconds: float) -> int:
        """Nearest sample."""
        later = int(np.clip(np.searchsorted(self.time, seconds), 1, len(self.time) - 1))
        return later - int(seconds - self.time[later - 1] < self.time[later] - seconds)

    def drawn(self, times: float) -> np.ndarray | None:
        """Simulated positions (T, n), with their difference from the measured ones multiplied by `times`."""
        return None if self.simulated is None else self.measured + times * (self.simulated - self.measured)


class Player:
    """A clock in its own thread; `show` is called with the seconds at every frame, and after a jump.

    Several threads may set `seconds`, `playing`, `speed` and `loop`.
    """

    def __init__(self, show: Callable[[float], None]) -> None:
        self._show, self._stop, self._wake = show, threading.Event(), threading.Event()
        self.seconds, self.duration, self.speed = 0.0, 1.0, 1.0
        self.playing, self.loop = False, True
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def refresh(self) -> None:
        """Show the current time again."""
        self._wake.set()

    def go(self, seconds: float) -> None:
        """Jump to a time in seconds."""
        self.seconds = min(max(seconds, 0.0), self.duration)
        self.refresh()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def _run(self) -> None:
        last = time.monotonic()
        while not self._stop.is_set():
            self._wake.wait(FRAME if self.playing else None)
            self._wake.clear()
            now = time.monotonic()
            if self.playing:
                self._advance(min(now - last, 0.2) * self.speed)
            last = now
            if not self._stop.is_set():
                self._show(self.seconds)

    def _advance(self, by: float) -> None:
        ahead = self.seconds + by
        if ahead > self.duration:
            ahead = ahead % max(self.duration, 1e-6) if self.loop else self.duration
            self.playing = self.loop
        self.seconds = ahead
