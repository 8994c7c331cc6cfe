"""`embodiedreamer demo`."""

from pathlib import Path

from embodiedreamer_gym.cli.options import QUIET, out_folder
from embodiedreamer_gym.io.files import check_outputs

TEXT = "from recordings with a hidden effect to a model that has it"
OPTIONS = (out_folder("gets model, recordings and report", Path("demo_report")), QUIET)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.demo import run

    check_outputs(folders=[a.out])
    run(a.out, progress)
