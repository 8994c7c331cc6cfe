"""States of a session, for undo and redo."""

from __future__ import annotations

from dataclasses import dataclass

from embodiedreamer_gym.robot import RobotModel


@dataclass(frozen=True)
class Step:
    """A model that was kept: one step of the staircase."""

    label: str
    model: RobotModel


@dataclass(frozen=True)
class State:
    """The steps so far, and the model shown: that of the last step, or one with an effect on trial on `joints`."""

    model: RobotModel
    steps: tuple[Step, ...]
    effect: str = ""
    joints: tuple[str, ...] = ()
    label: str = ""

    @property
    def base(self) -> RobotModel:
        """The last model that was kept."""
        return self.steps[-1].model
