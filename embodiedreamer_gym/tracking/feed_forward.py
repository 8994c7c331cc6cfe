"""Feed-forward commands of a model for a motion, instant by instant, with friction's direction and command delay."""

from __future__ import annotations

import numpy as np

from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.inverse_drive import InverseDrive

Array = np.ndarray
TRAVEL = {"rad": 2e-3, "m": 2e-4, "1": 2e-3}  # travel over which friction's direction goes from neutral to one side
BEHIND = {"rad": 12e-3, "m": 1.2e-3, "1": 12e-3}  # error at which friction is compensated in full


class FeedForward:
    """Computes the command of each instant for a desired motion from the model's own laws.

    Friction's direction follows the desired motion with a play of `TRAVEL` to either side, like bristles that bend: it
    is kept at rest, reverses within a fixed travel at any speed, and does not switch on small jitter of the desired
    positions.

    dt: time between two instants, s.
    """

    def __init__(self, model: RobotModel, dt: float) -> None:
        self.dt, self.drive = dt, InverseDrive(model, dt)
        self.lead = self.drive.lag + (0.5 * dt if model.command_hold == "hold" else 0.0)
        self.ahead = max(0, int(np.ceil(self.lead.max() / dt - 1e-9)))
        self._travel = np.array([TRAVEL[unit] for unit in model.units])
        self._behind = np.array([BEHIND[unit] for unit in model.units])

    def begin(self, position: Array) -> None:
        """Start with the joints at rest at a position (n,)."""
        self.drive.begin(position)
        self._start: Array | None = np.array(position, float)
        self._side = np.zeros(len(position))
        self._heard: Array | None = None
        self._last = np.zeros((2, len(position)))

    def command(self, positions: Array, error: Array | float = 0.0) -> Array:
        """Command (n,) of this instant.

        positions (k, n): desired now, at the next instant and so on, as many as are known; after them, the last
        acceleration is assumed to continue. error (n,): how far the joints are behind the desired positions.
        """
        if self._start is not None:  # the motion may begin elsewhere: that sets friction's direction, but no speed
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
        """Command (n,) that must reach the servo at this instant; moved (n,): desired motion since the last instant."""
        self._side = np.clip(self._side + moved / self._travel, -1.0, 1.0)
        direction = np.clip(self._side + error / self._behind, -1.0, 1.0)
        return self.drive.step(position, velocity, acceleration, direction)


def extended(path: Array, count: int) -> Array:
    """The first `count` positions of a path (k, n), k at least 3, that continues at its last acceleration."""
    k = np.arange(1, count - len(path) + 1)[:, None]
    speed, change = path[-1] - path[-2], path[-1] - 2 * path[-2] + path[-3]
    return np.vstack([path, path[-1] + k * speed + 0.5 * k * (k + 1) * change])[:count]
