"""`embodiedreamer diagnose`."""

from pathlib import Path

from embodiedreamer_gym.cli.inputs import check_results, load_logs, load_model, show
from embodiedreamer_gym.cli.options import LOGS, MODEL, REQUIRED, SPLIT, option, out_file

TEXT = "calibrate, then find the effects that are missing"
OPTIONS = (
    option("--model", "M", MODEL, REQUIRED),
    *SPLIT,
    out_file("FILE.json", "better model", None),
    option("--resume", "FILE", "keeps finished fits; goes on where it was interrupted", None, Path),
    *LOGS,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.diagnosis import diagnose, error_breakdown
    from embodiedreamer_gym.diagnosis.report import write_report

    check_results(a)
    model = load_model(a, a.model)
    train, test = (load_logs(a, model, part, fit=True) for part in (a.train, a.test))
    found = diagnose(model, train, test, jobs=a.jobs, seed=a.seed, progress=progress, refit_cache=a.resume)
    progress.close()
    show(a, found, lambda: write_report(
        a.report, diagnosis=found, breakdown=error_breakdown(found.calibrated, test), recordings=test
    ))  # fmt: skip
    if a.out:
        found.model.save(a.out)
