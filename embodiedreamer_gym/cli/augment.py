"""`embodiedreamer augment`."""

from typing import Any

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.errors import EmbodieDreamerError

EDITS = "recolour[:NAME,...], background[:FOLDER], table[:FOLDER], paper, inpaint:FOLDER"


@o.verb(
    o.option("--data", "DIR", "HDF5 episodes, such as those of `demos`", o.REQUIRED, nargs="+"),
    o.out_folder("output folder; an interrupted run resumes"),
    o.option("--edit", "EDIT", f"{EDITS} (default: none, only the video model)", [], nargs="+"),
    o.option("--prompt", "TEXT", "prompt for inpaint"),
    o.option("--copies", "N", "copies of each episode", 1, o.COUNT),
    o.option("--aligner", "A", "video model: lean, a file or folder", "lean"),
    o.option(
        "--bank",
        "B",
        "photos from which the first frame is composed: lab, a file, or none for the episode's own first frame",
        "lab",
    ),
    o.option(
        "--cameras", "NAMES", "cameras whose frames are generated, separated by commas; several without --edit", "head"
    ),
    o.SEED,
    o.option("--task", "TASK", "task of files that do not name it, such as PutCupOnMat-v0"),
    o.option("--robot", "M", f"robot for the replay: {o.MODELS} (default: the recorded one)"),
    o.JOBS,
    o.QUIET,
)
def run(a, progress):
    """Replay recorded episodes and generate new frames with the video model, from edited first frames."""
    from embodiedreamer_gym.envs import task_name
    from embodiedreamer_gym.pipelines.regenerate import regenerate
    from embodiedreamer_gym.vis_aligner.editing import Chain

    if a.prompt is not None and not any(edit.startswith("inpaint") for edit in a.edit):
        raise EmbodieDreamerError("--prompt is for --edit inpaint:FOLDER; leave it out.")
    edits = [_edit(*edit.partition(":")[::2]) for edit in a.edit]
    made = regenerate(
        a.data, a.out, a.aligner, None if a.bank == "none" else a.bank,
        None if not edits else edits[0] if len(edits) == 1 else Chain(edits), a.copies, a.seed, progress,
        prompt=a.prompt, task=None if a.task is None else task_name(a.task), robot=a.robot, jobs=a.jobs, cameras=tuple(a.cameras.split(",")),
    )  # fmt: skip
    text = f"{made.written + made.kept} episodes in {a.out}, {made.kept} of them from an earlier run"
    if made.failed:
        names = ", ".join(made.failed[:10]) + (", ..." if len(made.failed) > 10 else "")
        text += f"\n{len(made.failed)} recorded episodes no longer end in success and were left out: {names}"
    return text


def _edit(kind: str, value: str) -> Any:
    """One edit; kind: its name; value: the text after the colon."""
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
