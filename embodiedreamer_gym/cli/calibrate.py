"""`embodiedreamer calibrate`."""

import numpy as np

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model

METHODS = ("least-squares", "surrogate", "surrogate-trajectory", "annealing", "annealing-scaled", "cma-es")


@o.verb(
    o.RECORDINGS,
    o.MODEL,
    o.out_file("FILE.json", "output: calibrated model"),
    o.option("--method", None, "fitting method", METHODS[0], choices=METHODS),
    *o.FIT,
    *o.LOGS,
)
def run(a, progress):
    """Fit the parameters of a model to recordings."""
    from embodiedreamer_gym.diagnosis import compare
    from embodiedreamer_gym.phys_aligner import calibrate

    model = load_model(a, a.model)
    logs = load_logs(a, model, a.recordings, fit=True)
    fit = calibrate(model, logs, a.method, rng=np.random.default_rng(a.seed), progress=progress)
    comparison = compare([model, fit.model], logs, ("before", "calibrated")) if a.report else None
    return o.Result(fit, report={"calibration": fit, "comparison": comparison}, model=fit.model)
