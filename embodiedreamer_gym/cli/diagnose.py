"""`embodiedreamer diagnose`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_model, load_split


@o.verb(
    o.MODEL,
    *o.SPLIT,
    o.out_file("FILE.json", "output: improved model", None),
    o.option(
        "--resume",
        "FILE",
        "file for finished fits; after an interruption, the same command resumes from it",
        None,
        o.output_file,
    ),
    *o.FIT,
    *o.LOGS,
)
def run(a, progress):
    """Calibrate a model, then find the physical effects that it lacks."""
    from embodiedreamer_gym.diagnosis import diagnose, error_breakdown

    model = load_model(a, a.model)
    train, test = load_split(a, model)
    diagnosis = diagnose(model, train, test, jobs=a.jobs, seed=a.seed, progress=progress, refit_cache=a.resume)
    breakdown = error_breakdown(diagnosis.calibrated, test) if a.report else None
    report = {"diagnosis": diagnosis, "breakdown": breakdown, "recordings": test}
    return o.Result(diagnosis, report=report, model=diagnosis.model)
