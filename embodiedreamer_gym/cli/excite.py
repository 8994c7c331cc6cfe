"""`embodiedreamer excite`."""

from embodiedreamer_gym.cli.inputs import check_results, load_logs, load_model, show
from embodiedreamer_gym.cli.options import LOGS, MODEL, REQUIRED, option, out_file, real
from embodiedreamer_gym.errors import EmbodieDreamerError

TEXT = "the motion that tells two effects apart, safe to run: a csv of commands and a picture of it"
OPTIONS = (
    option("recordings", "REC", "what both effects have to explain so far", nargs="*"),
    option("--model", "M", MODEL, REQUIRED),
    option("--separate", "A,B", "two effects", REQUIRED),
    out_file("FILE.csv", "commands; FILE.png beside it"),
    option("--table", "Z", "height of a table in the URDF's root frame, m", None, real(-100.0, 100.0)),
    option("--seconds", "S", "of motion", 8.0, real(0.1, 600.0)),
    option("--speed", "X", "share of the speed limits, at most 1", 0.5, real(0.0, 1e9, above=True)),
    option("--acceleration", "A", "rad/s^2", 6.0, real(0.0, 1e4, above=True)),
    option("--reach", "R", "rad to either side", 0.6, real(0.0, 100.0, above=True)),
    *LOGS,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.diagnosis.experiment_design import propose_motion
    from embodiedreamer_gym.diagnosis.report.dry_run import dry_run
    from embodiedreamer_gym.io.files import atomic_file

    check_results(a)
    model = load_model(a, a.model)
    pair = tuple(name.strip() for name in a.separate.split(","))
    if len(pair) != 2:
        raise EmbodieDreamerError(f"--separate takes two effects with a comma between them, not '{a.separate}'.")
    logs = load_logs(a, model, a.recordings, fit=True) if a.recordings else ()
    proposal = propose_motion(
        model, pair, logs, a.seconds, min(a.speed, 1.0), a.acceleration, a.reach, table=a.table,
        seed=a.seed, progress=progress,
    )  # fmt: skip
    progress.close()
    show(a, proposal, lambda: a.report)
    proposal.save(a.out)
    picture = a.out.with_suffix(".png")
    with atomic_file(picture, suffix=".png") as part:
        dry_run(proposal).savefig(part, dpi=110)
    print(f"\ncommands: {a.out}\npicture: {picture}; look at it before the robot moves")
