"""Notes on the URDF and on the recordings' times that matter for reading a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.urdf_notes import urdf_notes


def notes_on(model: RobotModel, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Notes on model and recordings that a diagnosis begins with; empty if nothing is unusual.

    There are no notes on a URDF that was moved after the model was loaded.
    """
    notes: tuple[str, ...] = ()
    with suppress(ModelError):
        notes = tuple(f"Note: {note}." for note in urdf_notes(model.urdf))
    nominal = [recording for recording in recordings if recording.nominal_time]
    if not nominal:
        return notes
    many = "" if len(nominal) == len(recordings) else f"{len(nominal)} of {len(recordings)} recordings: "
    return (
        *notes,
        f"Note: {many}the times are sample numbers divided by a rate of {nominal[0].hz:.4g} Hz, not measured: command "
        f"and state of a sample may be {1e3 / nominal[0].hz:.0f} ms or more apart, so an identified delay includes "
        "the delay of the recorder.",
    )
