"""`embodiedreamer bench score`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.option("--truth", "DIR", "as `bench make` writes it", o.REQUIRED, Path),
    o.option("--answers", "FILE.jsonl", "answer files, of one entry or several", o.REQUIRED, Path, nargs="+"),
    o.QUIET,
    o.JSON,
)
def run(a, progress):
    """Score answers of any tool to hidden cases."""
    from embodiedreamer_gym.bench.score import score

    progress("scoring answers")
    return o.Result(score(a.truth, a.answers))
