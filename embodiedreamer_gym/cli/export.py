"""`embodiedreamer export`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model

WITHOUT = ("--seed", "--jobs", "--report", "--resume")  # options that an export does not use


@o.verb(
    o.option(
        "recordings",
        "REC",
        "recordings that MuJoCo replays with the exported file, for comparison with the rollouts of `compare` (optional)",
        nargs="*",
    ),
    o.MODEL,
    o.option("--to", None, "format of the file", o.REQUIRED, choices=("mjcf", "urdf")),
    o.out_file("FILE", "exported file; meshes are written to FILE_meshes"),
    o.option(
        "--timestep",
        "S",
        "time step of an MJCF, s (default: chosen from the model's effects)",
        None,
        o.number(float, 1e-6, 0.05),
    ),
    *(one for one in o.LOGS if one.name not in WITHOUT),
)
def run(a, progress):
    """Write a model with its effects as MJCF or URDF, and list what the format cannot express."""
    from embodiedreamer_gym.engines.export import export_model

    model = load_model(a, a.model)
    logs = load_logs(a, model, a.recordings) if a.recordings else ()
    return o.Result(export_model(model, a.out, a.to, a.timestep, logs))
