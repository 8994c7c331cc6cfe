"""Exports calibrated models to files for other simulators: MJCF and URDF."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from embodiedreamer_gym.engines.export.report import Export
from embodiedreamer_gym.errors import ModelError, brief
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel

FORMATS = ("mjcf", "urdf")

__all__ = ["FORMATS", "Export", "export_model"]


def export_model(
    model: RobotModel,
    path: str | Path,
    to: str = "mjcf",
    timestep: float | None = None,
    recordings: Sequence[Recording] = (),
) -> Export:
    """Write a model with the effects that a format can express; the others are listed in the result and in the file.

    path: the file; meshes are copied into the folder FILE_meshes beside it.
    to: one of FORMATS.
    timestep: s, of an MJCF; None: chosen from the model's effects.
    recordings: replayed in MuJoCo from the written file, and compared with the model's own rollouts.
    Raises: ModelError for another format, options that a URDF does not have, a file that cannot be read or written, or
    a path to the model's own URDF; SimulationError when a replay diverges or a recording is of another robot.
    """
    path = Path(path)
    if to not in FORMATS:
        raise ModelError(f"format {brief(to)} is not one of {', '.join(FORMATS)}.")
    if to == "urdf" and (timestep is not None or recordings):
        raise ModelError(
            "a URDF has neither a time step nor a controller to replay recordings with; export to mjcf for both."
        )
    if os.path.exists(path) and os.path.samefile(path, model.urdf):
        raise ModelError(f"{path} is the model's own URDF, which the export reads; give another file.")
    if to == "urdf":
        from embodiedreamer_gym.engines.export.urdf import write_urdf

        return write_urdf(model, path)
    from embodiedreamer_gym.engines.export.mjcf import write_mjcf
    from embodiedreamer_gym.engines.export.replay import agreement

    export = write_mjcf(model, path, timestep)
    return replace(export, agreement=agreement(path, model, recordings)) if recordings else export
