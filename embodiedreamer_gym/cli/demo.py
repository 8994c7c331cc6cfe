"""`embodiedreamer demo`."""

from pathlib import Path

from embodiedreamer_gym.cli import options as o


@o.verb(o.out_folder("output folder: model, recordings and report", Path("demo_report")), o.QUIET)
def run(a, progress):
    """Diagnose recordings of an arm with a hidden effect, and save a model that includes the effect."""
    from embodiedreamer_gym.demo import run

    run(a.out, progress)
