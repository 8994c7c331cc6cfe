"""`embodiedreamer breakdown`."""

from embodiedreamer_gym.cli.inputs import check_results, load_logs, load_model, show
from embodiedreamer_gym.cli.options import LOGS, MODEL, RECORDINGS, REQUIRED, option

TEXT = "a model's error by joint, regime and side (command or motion)"
OPTIONS = (RECORDINGS, option("--model", "M", MODEL, REQUIRED), *LOGS)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.diagnosis import error_breakdown
    from embodiedreamer_gym.diagnosis.report import write_report

    check_results(a)
    model = load_model(a, a.model)
    breakdown = error_breakdown(model, load_logs(a, model, a.recordings))
    progress.close()
    show(a, breakdown, lambda: write_report(a.report, breakdown=breakdown))
