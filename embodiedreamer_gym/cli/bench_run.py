"""`embodiedreamer bench run`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o

ENTRIES = ("diagnose", "coulomb", "ladder", "mujoco-sysid", "sparse", "boosted")


@o.verb(
    o.option("entries", "ENTRY", f"entries: {', '.join(ENTRIES)}", o.REQUIRED, nargs="+"),
    o.option("--cases", "DIR", "cases of `bench make`", o.REQUIRED, Path),
    o.SHARD,
    o.JOBS,
    o.QUIET,
    o.out_file("FILE.jsonl", "answers; an interrupted run resumes"),
)
def run(a, progress):
    """Run entries of this package on benchmark cases."""
    from embodiedreamer_gym.bench.run import run_entries

    answers = run_entries(a.entries, a.cases, a.out, a.jobs, progress, a.shard)
    failed = [answer for answer in answers if answer.failed]
    text = f"{len(answers)} answers in {a.out}"
    for answer in failed[:10]:
        text += f"\n{answer.entry} has no answer to case {answer.case}: {answer.failed}"
    return text
