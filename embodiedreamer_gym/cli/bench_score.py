"""`embodiedreamer bench score`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o


@o.verb(
    o.option("--truth", "DIR", "ground truth of `bench make`", o.REQUIRED, Path),
    o.option(
        "--answers",
        "FILE.jsonl",
        "answer files, of one or more entries or of the shards of a run",
        o.REQUIRED,
        Path,
        nargs="+",
    ),
    o.QUIET,
    o.JSON,
    o.RESULTS,
)
def run(a, progress):
    """Score the answers of one or more tools to benchmark cases."""
    from embodiedreamer_gym.bench.score import score
    from embodiedreamer_gym.io.results import write_results

    progress("scoring answers")
    scores = score(a.truth, a.answers)
    if a.results:
        write_results(a.results, scores.as_dict(), scores.run)
    return o.Result(scores)
