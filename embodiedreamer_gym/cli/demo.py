"""`embodiedreamer demo`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o


@o.verb(o.out_folder("folder for model, recordings and report", Path("demo_report")), o.QUIET)
def run(a, progress):
    """Diagnose recordings with a hidden effect, down to a model that has it."""
    from embodiedreamer_gym.demo import run

    run(a.out, progress)
