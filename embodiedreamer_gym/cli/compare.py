"""`embodiedreamer compare`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.cli.logs import load_logs, load_model

MODELS = o.option("--model", "M", f"{o.MODELS}; can be repeated for several models", o.REQUIRED, action="append")


@o.verb(o.RECORDINGS, MODELS, *o.LOGS)
def run(a, progress):
    """Compare the error of a model (or several) with the noise floor."""
    from embodiedreamer_gym.diagnosis import compare

    models = [load_model(a, source) for source in a.model]
    logs = load_logs(a, models[0], a.recordings)
    comparison = compare(models, logs, labels(a.model, [model.name for model in models]))
    return o.Result(comparison, report={"comparison": comparison})


def labels(sources: list[str], names: list[str]) -> list[str] | None:
    """Return distinct labels: the models' names, else their file stems, else their paths; None if paths repeat."""
    stems = [Path(source).stem for source in sources]
    return next((kind for kind in (names, stems, sources) if len(set(kind)) == len(kind)), None)
