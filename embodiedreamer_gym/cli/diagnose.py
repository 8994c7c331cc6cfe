"""`embodiedreamer diagnose`."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_model, load_split


@o.verb(
    o.MODEL,
    *o.SPLIT,
    o.out_file("FILE.json", "better model", None),
    o.option(
        "--resume",
        "FILE",
        "keeps finished fits; the same command continues from it after an interruption",
        None,
        o.output_file,
    ),
    *o.FIT,
    *o.LOGS,
)
def run(a, progress):
    """Calibrate, then find the effects that are missing."""
    from embodiedreamer_gym.diagnosis import diagnose, error_breakdown

    model = load_model(a, a.model)
    train, test = load_split(a, model)
    diagnosis = diagnose(model, train, test, jobs=a.jobs, seed=a.seed, progress=progress, refit_cache=a.resume)
    breakdown = error_breakdown(diagnosis.calibrated, test) if a.report else None
    report = {"diagnosis": diagnosis, "breakdown": breakdown, "recordings": test}
    return o.Result(diagnosis, report=report, model=diagnosis.model)
