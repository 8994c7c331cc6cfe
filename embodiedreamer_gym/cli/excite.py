"""`embodiedreamer excite`."""

import sys

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model
from embodiedreamer_gym.errors import EmbodieDreamerError


@o.verb(
    o.option("recordings", "REC", "recordings to which both effects are fitted first (optional)", nargs="*"),
    o.MODEL,
    o.option("--separate", "A,B", "the two effects to distinguish", o.REQUIRED),
    o.out_file("FILE.csv", "output: commands, and a plot in FILE.png"),
    o.option("--table", "Z", "height of a table in the URDF's root frame, m", None, o.number(float, -100.0, 100.0)),
    o.option(
        "--seconds",
        "S",
        "length of the motion, before it is slowed down to the limits",
        8.0,
        o.number(float, 0.1, 600.0),
    ),
    o.option("--speed", "X", "fraction of the speed limits, at most 1", 0.5, o.POSITIVE),
    o.option("--acceleration", "A", "largest acceleration, rad/s^2", 6.0, o.number(float, 0.0, 1e4, above=True)),
    o.option("--reach", "R", "largest deflection to either side, rad", 0.6, o.number(float, 0.0, 100.0, above=True)),
    *o.LOGS[:-1],
)
def run(a, progress):
    """Design a safe motion that distinguishes two effects: commands (csv) and a plot."""
    from embodiedreamer_gym.diagnosis.experiment_design import propose_motion
    from embodiedreamer_gym.diagnosis.report.dry_run import dry_run
    from embodiedreamer_gym.engines.clearance import without_shape
    from embodiedreamer_gym.io.files import atomic_file

    model = load_model(a, a.model)
    pair = tuple(name.strip() for name in a.separate.split(","))
    if len(pair) != 2:
        raise EmbodieDreamerError(f"--separate takes two effects with a comma between them, not '{a.separate}'.")
    if bare := without_shape(model):
        print(
            f"warning: {', '.join(bare)} have no collision shape in the URDF, so their clearance is not checked",
            file=sys.stderr,
        )
    logs = load_logs(a, model, a.recordings, fit=True) if a.recordings else ()
    proposal = propose_motion(
        model, pair, logs, a.seconds, min(a.speed, 1.0), a.acceleration, a.reach, table=a.table,
        seed=a.seed, progress=progress,
    )  # fmt: skip
    proposal.save(a.out)
    picture = a.out.with_suffix(".png")
    with atomic_file(picture, suffix=".png") as part:
        dry_run(proposal).savefig(part, dpi=110)
    text = f"{proposal}\n\ncommands: {a.out}\npicture: {picture}; check it before the robot moves"
    return o.Result(text, proposal.as_dict())
