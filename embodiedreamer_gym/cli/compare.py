"""`embodiedreamer compare`."""

from pathlib import Path

from embodiedreamer_gym.cli.inputs import check_results, load_logs, load_model, show
from embodiedreamer_gym.cli.options import LOGS, MODEL, RECORDINGS, REQUIRED, option

TEXT = "error of a model (or several) against the noise floor"
OPTIONS = (
    RECORDINGS,
    option("--model", "M", f"{MODEL}; more models: --model again", REQUIRED, action="append"),
    *LOGS,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.diagnosis import compare
    from embodiedreamer_gym.diagnosis.report import write_report

    check_results(a)
    models = [load_model(a, source) for source in a.model]
    logs = load_logs(a, models[0], a.recordings)
    comparison = compare(models, logs, labels(a.model, [model.name for model in models]))
    progress.close()
    show(a, comparison, lambda: write_report(a.report, comparison=comparison))


def labels(sources: list[str], names: list[str]) -> list[str] | None:
    """What tells the models apart: their names, or their files' stems, or their paths; None where even these are the same."""
    stems = [Path(source).stem for source in sources]
    return next((kind for kind in (names, stems, sources) if len(set(kind)) == len(kind)), None)
