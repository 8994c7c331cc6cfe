"""What augmentation is worth: policies of original, generated and mixed episodes, on the original bench and on changed ones.

python -m benchmarks augmentation --out DIR [--task PutCupOnMat] [--demos 50] [--copies 1] [--steps N] [--episodes 100]
                                  [--seed 0] [--jobs 1]

The original bench is the generated one (`embodiedreamer augment` without an edit); of each of its episodes as many copies are
generated with object colours drawn at random as with a table and a sheet of A4 drawn at random. Evaluated in the generated world on
unseen scenes: as it is, with the object in a colour of its own, and on another table with a sheet. Everything is kept in DIR:
an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from benchmarks.act_runs import SIZE, keep_settings, play_each, played, train_act
from benchmarks.common import clopper_pearson

EVERY = 5  # actions from one generated frame to the next
SCENES = ("original", "foreground", "background")
POLICIES = {"original": SCENES[:1], "mixed": SCENES, "generated": SCENES[1:]}
FIRST_SEED = 600_000
COLOUR = (40, 70, 220)  # of the object, where it is changed; the shipped one is red


def edits(scene: str, colour: tuple[str, ...] | None = None) -> Any:
    """The editor of a scene; colour: objects to be painted in COLOUR, where all in a colour that is drawn are not wanted."""
    from embodiedreamer_gym.envs.cameras import CAMERAS
    from embodiedreamer_gym.vis_aligner.editing import Background, Chain, PaperSheet, Recolour

    if scene == "foreground":
        return Recolour() if colour is None else Recolour(colour, COLOUR)
    return Chain([Background(("table",)), PaperSheet(CAMERAS["head"])]) if scene == "background" else None


def episodes(a: argparse.Namespace) -> dict[str, Path]:
    """Folders of original and generated episodes."""
    from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
    from embodiedreamer_gym.pipelines.regenerate import regenerate

    plain = a.out / f"demos_{a.task}"
    record_demonstrations(Demonstrations(a.task, size=SIZE), a.demos, plain)
    found = {scene: a.out / f"{scene}_{a.task}" for scene in SCENES}
    for scene, folder in found.items():
        copies = 1 if scene == "original" else a.copies
        regenerate(plain, folder, editor=edits(scene), copies=copies, seed=a.seed, jobs=a.jobs)
    return found


def trained(a: argparse.Namespace, name: str, data: dict[str, Path]) -> Path:
    """Folder of a policy; all of them take as many steps."""
    from embodiedreamer_gym.recordings.episodes import mixed

    folder = a.out / f"policy_{a.task}_{name}_{a.seed}"

    def told(count: int, of: int, text: str) -> None:
        if count % 500 == 0:
            print(f"{name}: step {count} of {of}, {text}", flush=True)

    joined = mixed(*(data[kind] for kind in POLICIES[name]))
    train_act(joined, folder, {"steps": a.steps, "seed": a.seed}, told)
    return folder


def judged(a: argparse.Namespace, name: str, scene: str, data: dict[str, Path]) -> list[bool]:
    """Successes on unseen scenes; those of an interrupted run are kept."""
    import gymnasium as gym

    from embodiedreamer_gym.envs.tasks import TASKS
    from embodiedreamer_gym.policies import load_policy
    from embodiedreamer_gym.wrappers import VisAlignerObservationWrapper

    path = a.out / f"judged_{a.task}_{name}_{scene}_{a.seed}.json"
    policy = load_policy(str(trained(a, name, data)))
    env: Any = gym.make(f"EmbodieDreamer/{a.task}-v0", image_size=SIZE)
    env = VisAlignerObservationWrapper(
        env, chunk=policy.chunk, editor=edits(scene, (TASKS[a.task].object.name,)), every=EVERY
    )
    rows = play_each(path, a.episodes, lambda n: played(policy, env, FIRST_SEED + n), f"{name} on {scene}")
    env.close()
    return [row["success"] for row in rows]


def main() -> None:
    """Train and judge what is missing, then print success by policy and scene."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--task", default="PutCupOnMat")
    for name, value in (("demos", 50), ("copies", 1), ("steps", None), ("episodes", 100), ("seed", 0), ("jobs", 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    a = parser.parse_args()
    import torch

    import embodiedreamer_gym  # noqa: F401  its environments are registered

    torch.set_num_threads(1)
    keep_settings(a.out, demos=a.demos, copies=a.copies, steps=a.steps)
    data, lines = episodes(a), ["| trained on | " + " | ".join(SCENES) + " |", "|---" * (len(SCENES) + 1) + "|"]
    for name in POLICIES:
        cells = []
        for scene in SCENES:
            rows = judged(a, name, scene, data)
            low, high = clopper_pearson(sum(rows), len(rows))
            cells.append(f"{sum(rows) / len(rows):.1%} ({low:.1%} .. {high:.1%})")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
