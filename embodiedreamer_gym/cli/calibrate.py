"""`embodiedreamer calibrate`."""

import numpy as np

from embodiedreamer_gym.cli.inputs import check_results, load_logs, load_model, show
from embodiedreamer_gym.cli.options import LOGS, MODEL, RECORDINGS, REQUIRED, option, out_file

METHODS = ("least-squares", "surrogate", "surrogate-trajectory", "annealing", "annealing-scaled", "cma-es")
TEXT = "fit a model's parameters"
OPTIONS = (
    RECORDINGS,
    option("--model", "M", MODEL, REQUIRED),
    out_file("FILE.json", "calibrated model"),
    option("--method", None, "of the fit (default: %(default)s)", METHODS[0], choices=METHODS),
    *LOGS,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.diagnosis import compare
    from embodiedreamer_gym.diagnosis.report import write_report
    from embodiedreamer_gym.phys_aligner import calibrate

    check_results(a)
    model = load_model(a, a.model)
    logs = load_logs(a, model, a.recordings, fit=True)
    fit = calibrate(model, logs, a.method, rng=np.random.default_rng(a.seed), progress=progress)
    progress.close()
    show(a, fit, lambda: write_report(
        a.report, calibration=fit, comparison=compare([model, fit.model], logs, ("before", "calibrated"))
    ))  # fmt: skip
    fit.model.save(a.out)
