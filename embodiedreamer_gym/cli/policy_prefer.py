"""`embodiedreamer policy prefer`."""

from dataclasses import fields

from embodiedreamer_gym.cli.options import (
    BANK,
    COUNT,
    EXECUTE,
    JOBS,
    JSON,
    QUIET,
    REQUIRED,
    ROBOT,
    SEED,
    TASK,
    VIS_ALIGNER,
    option,
    out_folder,
    real,
)  # fmt: skip
from embodiedreamer_gym.io.files import check_outputs, write_json
from embodiedreamer_gym.pipelines import FRAME_INTERVAL

METHODS = ("preferences", "best_of", "top", "rwr")
PAIRINGS, PER = ("same_start", "global_rank"), ("chunk", "step")
TEXT = "improve a policy on its own rollouts: cycles of rolling out, ranking and fine-tuning; goes on where it was"
OPTIONS = (
    option("--policy", "P", "a folder, or package.module:function", REQUIRED),
    TASK,
    out_folder("the policy, and what each cycle left"),
    option("--cycles", "N", "of rolling out and learning", 5, COUNT),
    option("--evaluations", "N", "episodes after each cycle", 100, COUNT),
    ROBOT,
    VIS_ALIGNER,
    BANK,
    option("--every", "N", "show the video model's picture after every N-th action and a chunk's last", FRAME_INTERVAL, COUNT),
    EXECUTE,
    option("--envs", "E", "episodes at once; the last digits of what is computed depend on it", 1, COUNT),
    JOBS,
    SEED,
    QUIET,
    JSON,
    option("--starts", "N", "rollouts: starts of a cycle", 100, COUNT),
    option("--tries", "K", "rollouts: from each start", 4, COUNT),
    option("--noise", "S", "rollouts: of exploration, normalised", 0.1, real(0.0)),
    option("--per", None, "rollouts: one noise per chunk or step (default: %(default)s)", "chunk", choices=PER),
    option("--metric", "M", "remaining (how near it came to the object, then that to its goal), object_distance,"
           " or distance (end effector to target, the paper's)", "remaining"),
    option("--pairing", None, "of rollouts (default: %(default)s)", "same_start", choices=PAIRINGS),
    option("--top", "M", "pairs, or trajectories, at most (the paper's 25)", None, COUNT),
    option("--margin", "X", "near ties are left out, m", 0.005, real(0.0)),
    option("--method", None, "preferences; or clone the best_of each start, the top of all, or all by reward (rwr)",
           METHODS[0], choices=METHODS),
    option("--variant", "V", "paper, ipo, nll, dpop, clipped, clipped+dpop", "clipped+dpop"),
    option("--beta", "B", "of the preference loss", 0.1, real(0.0)),
    option("--sigma", "S", "of the likelihood; the paper's is 1", 4.0, real(0.0, above=True)),
    option("--epochs", "N", "of a cycle", 80, COUNT),
    option("--batch", "N", "pairs of a step (25), or chunks to clone (256)", None, COUNT),
    option("--learning-rate", "R", "of Adam (default 3e-5 for preferences, 1e-4 to clone)", None, real(0.0, 1e3, True)),
    option("--fall", "NATS", "stop where the winners' likelihood falls further; 0: never", 5.0, real(0.0)),
)  # fmt: skip


def run(a, progress) -> None:
    """Run the cycles that are missing, then print the table."""
    import torch

    from embodiedreamer_gym.pipelines.preference_study import WEIGHTS, Study, table
    from embodiedreamer_gym.pipelines.study_settings import StudySettings

    torch.set_num_threads(1)
    check_outputs(a.json, folders=[a.out])
    settings = StudySettings(**{field.name: getattr(a, field.name) for field in fields(StudySettings)})
    study = Study(settings, a.out, progress)  # complains before anything is written
    try:
        rows = []
        for cycle in range(a.cycles + 1):
            rows.append(study.row(cycle))
            if hasattr(study.policy, "save"):
                study.policy.save(a.out / "policy")
    finally:
        study.close()
    print(table(rows))
    saved = hasattr(study.policy, "save")
    print(f"policy: {a.out / 'policy'}" if saved else f"weights: {study.folder(a.cycles) / WEIGHTS}")
    if a.json is not None:
        write_json({"settings": study.settings, "rows": rows}, a.json)
