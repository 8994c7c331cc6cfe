"""`embodiedreamer augment`."""

from typing import Any

from embodiedreamer_gym.cli.options import COUNT, JOBS, MODEL, QUIET, REQUIRED, SEED, option, out_folder
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import check_outputs

EDITS = "recolour[:NAME,...], background[:FOLDER], table[:FOLDER], paper, inpaint:FOLDER"
TEXT = "replay recorded episodes and film them anew through the video model, from edited first frames"
OPTIONS = (
    option("--data", "DIR", "HDF5 episodes, as `demos` writes them", REQUIRED, nargs="+"),
    out_folder("goes on where it was"),
    option("--edit", "EDIT", f"{EDITS} (default: none, the video model alone)", [], nargs="+"),
    option("--prompt", "TEXT", "what inpaint is to paint"),
    option("--copies", "N", "of each episode", 1, COUNT),
    option("--aligner", "A", "video model: lean, a file or folder", "lean"),
    option("--bank", "B", "photos for the first frame: lab, a file, or none for the episode's own", "lab"),
    SEED,
    option("--task", "TASK", "of files that do not say it, such as PutCupOnMat-v0"),
    option("--robot", "M", f"that replays: {MODEL} (default: the recorded one)"),
    JOBS,
    QUIET,
)


def run(a, progress) -> None:
    """Run the verb."""
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.pipelines.regenerate import regenerate
    from embodiedreamer_gym.vis_aligner.editing import Chain

    check_outputs(folders=[a.out])
    if a.prompt is not None and not any(edit.startswith("inpaint") for edit in a.edit):
        raise EmbodieDreamerError("--prompt is for --edit inpaint:FOLDER; leave it out.")
    edits = [_edit(*edit.partition(":")[::2]) for edit in a.edit]
    made = regenerate(
        a.data, a.out, a.aligner, None if a.bank == "none" else a.bank,
        None if not edits else edits[0] if len(edits) == 1 else Chain(edits), a.copies, a.seed, progress,
        prompt=a.prompt, task=None if a.task is None else task_name(a.task), robot=a.robot, jobs=a.jobs,
    )  # fmt: skip
    progress.close()
    print(f"{made.written + made.kept} episodes in {a.out}, {made.kept} of them were there")
    if made.failed:
        print(f"{len(made.failed)} recorded episodes no longer end in success and were left out: "
              f"{', '.join(made.failed[:10])}{', ...' if len(made.failed) > 10 else ''}")  # fmt: skip


def _edit(kind: str, value: str) -> Any:
    """One edit: its name, and what follows the colon."""
    from embodiedreamer_gym.envs.cameras import CAMERAS
    from embodiedreamer_gym.vis_aligner.editing import Background, Inpaint, PaperSheet, Recolour

    if kind == "recolour":
        return Recolour(tuple(value.split(",")) if value else None)
    if kind == "background":
        return Background(pictures=value or None)
    if kind == "table":
        return Background(("table",), value or None)
    if kind == "paper" and not value:
        return PaperSheet(CAMERAS["head"])
    if kind == "inpaint" and value:
        return Inpaint(value)
    raise EmbodieDreamerError(f"--edit {kind}{':' if value else ''}{value} is none of {EDITS}.")
