"""`embodiedreamer bench score`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.option("--truth", "DIR", "as `bench make` writes it", o.REQUIRED, Path),
    o.option(
        "--answers",
        "FILE.jsonl",
        "answer files: of one entry or several, or of the shards of one run",
        o.REQUIRED,
        Path,
        nargs="+",
    ),
    o.QUIET,
    o.JSON,
    o.RESULTS,
)
def run(a, progress):
    """Score answers of any tool to hidden cases."""
    from embodiedreamer_gym.bench.score import score
    from embodiedreamer_gym.io.results import write_results

    progress("scoring answers")
    scores = score(a.truth, a.answers)
    if a.results:
        write_results(a.results, scores.as_dict(), scores.run)
    return o.Result(scores)
