"""`embodiedreamer add`."""

from embodiedreamer_gym.cli.inputs import check_results, load_logs, load_model, show
from embodiedreamer_gym.cli.options import LOGS, MODEL, REQUIRED, SPLIT, option, out_file

TEXT = "add an effect and fit again"
OPTIONS = (
    option("effect", "EFFECT", "one of `embodiedreamer effects`, or of --effects", REQUIRED),
    option("--model", "M", MODEL, REQUIRED),
    *SPLIT,
    out_file("FILE.json", "model with the effect"),
    *LOGS,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.diagnosis import add_effect
    from embodiedreamer_gym.diagnosis.report import write_report

    check_results(a)
    model = load_model(a, a.model)
    richer = model.with_effect(a.effect)  # complains about an unknown effect before any log is read
    train, test = (load_logs(a, richer, part, fit=True) for part in (a.train, a.test))
    found = add_effect(model, a.effect, train, test, progress=progress)
    progress.close()
    show(a, found, lambda: write_report(a.report, calibration=found.after, comparison=found.comparison))
    found.after.model.save(a.out)
