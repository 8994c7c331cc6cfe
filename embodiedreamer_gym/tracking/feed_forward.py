"""Commands that a model needs for a motion, instant by instant, with the direction of its friction and the delay of its commands."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.inverse_drive import InverseDrive

Array = np.ndarray
TRAVEL = {"rad": 2e-3, "m": 2e-4, "1": 2e-3}  # over which friction's direction changes from the middle to one side
BEHIND = {"rad": 12e-3, "m": 1.2e-3, "1": 12e-3}  # of the wanted position, at which friction is overcome in full


class FeedForward:
    """The command of each instant for a wanted motion, from the model's own laws.

    Friction's direction follows the wanted motion through a play of `TRAVEL` to either side, as bristles that bend: it is kept
    at rest, turns within a fixed travel at any speed, and small jitter of the wanted positions does not make it switch.

    dt: time between two instants, s.
    """

    def __init__(self, model: RobotModel, dt: float) -> None:
        self.dt, self.drive = dt, InverseDrive(model, dt)
        self.lead = self.drive.lag + (0.5 * dt if model.command_hold == "hold" else 0.0)
        self.ahead = max(0, int(np.ceil(self.lead.max() / dt - 1e-9)))
        self._travel = np.array([TRAVEL[unit] for unit in model.units])
        self._behind = np.array([BEHIND[unit] for unit in model.units])

    def begin(self, position: Array) -> None:
        """The joints rest at a position (n,)."""
        self.drive.begin(position)
        self._start: Array | None = np.array(position, float)
        self._side = np.zeros(len(position))
        self._heard: Array | None = None
        self._last = np.zeros((2, len(position)))

    def command(self, positions: Array, error: Array | float = 0.0) -> Array:
        """Command (n,) of this instant.

        positions (k, n): wanted now, at the next instant and so on, as far as they are known; later ones are taken to go on
        at the last acceleration. error (n,): by how much the joints are behind what was wanted.
        """
        if self._start is not None:  # which need not be where the motion begins: no speed, but friction's direction
            self._side = np.clip((positions[0] - self._start) / self._travel, -1.0, 1.0)
            self._start, self._last = None, np.stack([positions[0]] * 2)
        path = extended(np.vstack([self._last, positions]), self.ahead + 4)[1:]
        before, place = self._heard, self._step(path, 0, error)
        heard, back = [place if before is None else before, place], (self.drive.memories(), self._side)
        for k in range(1, self.ahead + 1):
            heard.append(self._step(path, k, error))
        self.drive.recall(back[0])
        self._side, self._heard, self._last = back[1], place, path[:2]
        times = np.arange(-1, self.ahead + 1) * self.dt
        return np.array([np.interp(lead, times, one) for lead, one in zip(self.lead, np.array(heard).T, strict=True)])

    def _step(self, path: Array, k: int, error: Array | float) -> Array:
        before, now, after = path[k : k + 3]
        velocity, acceleration = (after - before) / (2 * self.dt), (after - 2 * now + before) / self.dt**2
        return self.step(now, velocity, acceleration, now - before, error)

    def step(
        self, position: Array, velocity: Array, acceleration: Array, moved: Array, error: Array | float = 0.0
    ) -> Array:
        """Command (n,) that must reach the servo at this instant; moved (n,): since the last one."""
        self._side = np.clip(self._side + moved / self._travel, -1.0, 1.0)
        direction = np.clip(self._side + error / self._behind, -1.0, 1.0)
        return self.drive.step(position, velocity, acceleration, direction)


def extended(path: Array, count: int) -> Array:
    """The first `count` positions of a path (k, n) of three or more, which goes on at its last acceleration."""
    k = np.arange(1, count - len(path) + 1)[:, None]
    speed, change = path[-1] - path[-2], path[-1] - 2 * path[-2] + path[-3]
    return np.vstack([path, path[-1] + k * speed + 0.5 * k * (k + 1) * change])[:count]
