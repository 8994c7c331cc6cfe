"""The action `policy prefer`: cycles of rolling out, ranking and fine-tuning; one row of a table for each."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import EmbodieDreamerError, PolicyError

METHODS = ("preferences", "best_of", "top", "rwr")
FIRST_START, FIRST_EVALUATION = (
    300_000_000,
    200_000,
)  # seeds; demonstrations count from 0, `policy evaluate` from 100 000
SETTINGS, ROW, WEIGHTS, PAIRS = "settings.json", "row.json", "weights.pt", "pairs.hdf5"
NOT_SETTINGS = ("verb", "out", "cycles", "quiet", "json", "envs")  # a study may go on with others
ROW_KEYS = ("success", "distance", "object_distance", "pairs", "contrast", "gradient", "winners", "losers")


def add_prefer(actions: Any) -> None:
    """Add the action to those of `policy`."""
    text = "improve a policy on its own rollouts: cycles of rolling out, ranking and fine-tuning; goes on where it was"
    one = actions.add_parser("prefer", help=text, description=text)
    one.set_defaults(verb=_prefer)
    one.add_argument("--policy", required=True, metavar="P", help="a folder, or package.module:function")
    one.add_argument("--task", required=True, metavar="ID", help="such as PutCupOnMat-v0")
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="the policy, and what each cycle left")
    one.add_argument("--cycles", type=_count, default=5, metavar="N", help="default: %(default)s")
    one.add_argument(
        "--evaluations", type=_count, default=100, metavar="N", help="episodes after each cycle (default %(default)s)"
    )
    one.add_argument("--robot", default="aloha", metavar="M", help="JSON file or built-in robot (default %(default)s)")
    one.add_argument(
        "--dream", nargs="?", const="lean", metavar="ALIGNER", help="see through VisAligner (default: lean)"
    )
    one.add_argument("--bank", default="lab", metavar="B", help="references to dream from (default %(default)s)")
    one.add_argument("--execute", type=_count, metavar="K", help="actions executed of each chunk (default: all)")
    one.add_argument("--envs", type=_count, default=1, metavar="E", help="episodes at once (default %(default)s)")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    one.add_argument("--quiet", action="store_true", help="no progress")
    one.add_argument("--json", type=Path, metavar="FILE", help="write the rows as JSON")
    _rollout_options(one.add_argument_group("rollouts and pairs"))
    _learning_options(one.add_argument_group("learning"))


def _rollout_options(group: Any) -> None:
    group.add_argument("--starts", type=_count, default=100, metavar="N", help="of a cycle (default %(default)s)")
    group.add_argument("--tries", type=_count, default=4, metavar="K", help="from each start (default %(default)s)")
    group.add_argument(
        "--noise", type=float, default=0.1, metavar="S", help="of exploration, normalised (default %(default)s)"
    )
    group.add_argument("--per", choices=("chunk", "step"), default="chunk", help="noise per (default %(default)s)")
    group.add_argument(
        "--metric", default="distance", metavar="M", help="distance (end effector to target) or object_distance"
    )
    group.add_argument(
        "--pairing", choices=("same_start", "global_rank"), default="same_start", help="default: %(default)s"
    )
    group.add_argument("--top", type=_count, metavar="M", help="pairs, or trajectories, at most (the paper's 25)")
    group.add_argument(
        "--margin", type=float, default=0.01, metavar="X", help="near ties are left out, m (default %(default)s)"
    )


def _learning_options(group: Any) -> None:
    group.add_argument("--method", choices=METHODS, default=METHODS[0],
                       help="preferences; or clone the best_of each start, the top of all, or all by reward (rwr)")  # fmt: skip
    group.add_argument(
        "--variant", default="clipped+dpop", metavar="V", help="paper, ipo, nll, dpop, clipped, clipped+dpop"
    )
    group.add_argument("--beta", type=float, default=0.1, metavar="B", help="default: %(default)s")
    group.add_argument("--sigma", type=float, default=1.0, metavar="S", help="of the likelihood (default %(default)s)")
    group.add_argument("--epochs", type=_count, default=80, metavar="N", help="of a cycle (default %(default)s)")
    group.add_argument("--batch", type=_count, metavar="N", help="pairs of a step (25), or chunks to clone (256)")
    group.add_argument("--rate", type=float, default=1e-5, metavar="R", help="of Adam (default %(default)s)")
    group.add_argument("--fall", type=float, default=5.0, metavar="NATS",
                       help="the guard stops where winners fall further (default %(default)s; 0: no guard)")  # fmt: skip


def _prefer(a: argparse.Namespace, progress: Any) -> None:
    """Run the cycles that are missing, then print the table."""
    import torch

    from embodiedreamer_gym.policies.progress import Progress
    from embodiedreamer_gym.robot.files import write_json

    torch.set_num_threads(1)
    if a.json is not None and not a.json.absolute().parent.is_dir():
        raise EmbodieDreamerError(f"folder {a.json.absolute().parent} does not exist; make it first.")
    study = Study(a, Progress(a.quiet))  # complains before anything is written
    try:
        rows = []
        for cycle in range(a.cycles + 1):
            rows.append(study.row(cycle))
            if hasattr(study.policy, "save"):
                study.policy.save(a.out / "policy")
    finally:
        study.close()
    print(table(rows))
    print(
        f"policy: {a.out / 'policy'}"
        if hasattr(study.policy, "save")
        else f"weights: {study.folder(a.cycles) / WEIGHTS}"
    )
    if a.json is not None:
        write_json({"settings": study.settings, "rows": rows}, a.json)


class Study:
    """A policy, an environment, and a folder with what each cycle left: weights, pairs, and a row, written last."""

    def __init__(self, a: argparse.Namespace, said: Any) -> None:
        from embodiedreamer_gym.policies import load_policy

        self.a, self.said = a, said
        self.policy: Any = load_policy(a.policy)  # one with a network
        if not hasattr(getattr(self.policy, "network", None), "mean"):
            raise PolicyError(f"policy {a.policy} has no network to fine-tune; give one that `policy train` wrote.")
        self.config = _config(a)
        self.settings = {k: v for k, v in sorted(vars(a).items()) if k not in NOT_SETTINGS}
        self.env = environment(a, self.policy)
        path = a.out / SETTINGS
        if not path.is_file():
            from embodiedreamer_gym.robot.files import write_json

            a.out.mkdir(parents=True, exist_ok=True)
            write_json(self.settings, path)
        elif json.loads(path.read_text()) != self.settings:
            raise EmbodieDreamerError(
                f"{a.out} holds a study with other settings; give another folder, or the same settings."
            )

    def close(self) -> None:
        """End the progress and the environment."""
        self.said.close()
        self.env.close()

    def folder(self, cycle: int) -> Path:
        """Where a cycle leaves what it made; 0 is the policy as it was given."""
        return self.a.out / f"cycle-{cycle:02d}"

    def row(self, cycle: int) -> dict[str, Any]:
        """What a cycle reached: read, with its weights, or run."""
        import torch

        from embodiedreamer_gym.robot.files import write_json

        folder = self.folder(cycle)
        folder.mkdir(exist_ok=True)
        if (folder / ROW).is_file():
            self.policy.network.load_state_dict(torch.load(folder / WEIGHTS, weights_only=True, map_location="cpu"))
            return json.loads((folder / ROW).read_text())
        told = self._learn(cycle, folder) if cycle else {}
        part = folder / f".{WEIGHTS}.part"
        torch.save(self.policy.network.state_dict(), part)
        part.replace(folder / WEIGHTS)
        row = {"cycle": cycle, **self._judge(), **told}
        write_json(row, folder / ROW)
        return row

    def _rollouts(self, tries: int, noise: float) -> Any:
        from embodiedreamer_gym.wrappers import preference_rollout as rollout

        options = {"tries": tries, "noise": noise, "per": self.a.per}
        if self.a.envs == 1:
            return rollout.PreferenceRolloutWrapper(self.env, **options)
        return rollout.PreferenceRolloutVectorWrapper(self.env, **options)

    def _judge(self) -> dict[str, Any]:
        """Success on scenes that no cycle learns from, without noise."""
        seeds = range(FIRST_EVALUATION, FIRST_EVALUATION + self.a.evaluations)
        ends = [one.outcome for one in self._rollouts(1, 0.0).rollouts(self.policy, seeds, progress=self.said)]
        found: dict[str, Any] = {"episodes": len(ends), "success": sum(end["is_success"] for end in ends) / len(ends)}
        return found | {k: sum(e[k] for e in ends) / len(ends) for k in ("distance", "object_distance") if k in ends[0]}

    def _learn(self, cycle: int, folder: Path) -> dict[str, Any]:
        """Roll out, choose and fine-tune; what is left of the rollouts are the pairs."""
        import shutil

        first = FIRST_START + 1_000_000 * self.a.seed + 10_000 * cycle
        files = self._rollouts(self.a.tries, self.a.noise).record(
            self.policy, range(first, first + self.a.starts), folder / "rollouts", progress=self.said
        )
        told = self._prefer(files, folder) if self.a.method == METHODS[0] else self._clone(files)
        shutil.rmtree(folder / "rollouts")
        return told

    def _prefer(self, files: Sequence[Path], folder: Path) -> dict[str, Any]:
        from embodiedreamer_gym.policies.preferences import PreferenceSet, fine_tune, load_trajectories

        found, a = [], self.a
        for path in files:
            tries = load_trajectories(path)[0]
            if a.pairing == "same_start":  # only the best and the worst can be of a pair
                tries = sorted(tries, key=lambda one: one.score(a.metric))
                tries = tries[:1] + tries[1:][-1:]
            found += tries
        pairs = PreferenceSet.choose(found, a.metric, a.pairing, a.top, a.margin)
        pairs.save(folder / PAIRS)
        tuned = fine_tune(self.policy.network, pairs, self.config, self.said)
        return {"pairs": len(pairs), "contrast": pairs.contrast, "gradient": tuned.gradient, "winners": tuned.winner[-1],
                "losers": tuned.loser[-1], "stopped": tuned.stopped}  # fmt: skip

    def _clone(self, files: Sequence[Path]) -> dict[str, Any]:
        from embodiedreamer_gym.policies.preferences import clone, filtered, load_trajectories, reward_weights

        a, weights = self.a, None
        found = [one for path in files for one in load_trajectories(path)[0]]
        if a.method == "rwr":
            weights = reward_weights(found, a.metric).tolist()
        else:
            found = filtered(found, a.metric, a.method, a.top or 25)
        clone(self.policy.network, found, self.config, weights, self.said)
        return {"pairs": len(found)}


def environment(a: argparse.Namespace, policy: Any) -> Any:
    """The task's environment, or a vector of them, that takes chunks; dreamed where asked for."""
    import gymnasium

    from embodiedreamer_gym import wrappers
    from embodiedreamer_gym.policies.evaluation import executed
    from embodiedreamer_gym.vis_aligner import load_bank

    config = getattr(policy.network, "config", None)
    size = (128, 96) if config is None else getattr(config, "source_size", None) or config.image_size
    cameras, filmed = tuple(getattr(policy, "cameras", ())) or ("head",), {}
    if a.dream is not None:
        if cameras != ("head",):
            raise PolicyError(f"the policy looks through {', '.join(cameras)}, and only the head camera is dreamed.")
        size = load_bank(a.bank).size
        filmed = {"camera": "head", "size": size}
    count = executed(policy, a.execute)

    def chunked(env: Any) -> Any:
        return wrappers.ActionChunk(env, count, **filmed)

    options = {"cameras": cameras, "image_size": size, "robot": a.robot}
    if a.envs == 1:
        env = chunked(gymnasium.make(_task(a.task), **options))
        return env if a.dream is None else wrappers.VisAlignerObservationWrapper(env, a.dream, a.bank)
    envs = gymnasium.make_vec(_task(a.task), a.envs, "sync", wrappers=[chunked], **options)
    return envs if a.dream is None else wrappers.VisAlignerVectorWrapper(envs, a.dream, a.bank)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """One line for each cycle; cycle 0 is the policy as it was given."""
    lines = ["cycle" + "".join(f"{key.replace('_', ' '):>17}" for key in ROW_KEYS)]
    for row in rows:
        cells = [f"{row[key]:>17.3g}" if row.get(key) is not None else f"{'':>17}" for key in ROW_KEYS]
        note = f"   stopped in epoch {row['stopped']}" if row.get("stopped") else ""
        lines.append(f"{row['cycle']:>5}" + "".join(cells) + note)
    return "\n".join(lines)


def _config(a: argparse.Namespace) -> Any:
    """How the policy learns, of the options."""
    from embodiedreamer_gym.policies.preferences import CloningConfig, LossConfig, TuningConfig

    if a.method != METHODS[0]:
        return CloningConfig(a.epochs, a.batch or 256, a.rate, a.seed)
    loss = LossConfig(a.variant, a.beta)
    return TuningConfig(loss, a.sigma, a.epochs, a.batch or 25, a.rate, a.fall or None, seed=a.seed)


def _task(text: str) -> str:
    """Gymnasium's id of a task, given by id or by name."""
    from embodiedreamer_gym.envs import NAMES

    name = text.removeprefix("EmbodieDreamer/").removesuffix("-v0")
    if name not in NAMES:
        raise EmbodieDreamerError(f"there is no task '{text}'; there are {', '.join(NAMES)}.")
    return f"EmbodieDreamer/{name}-v0"


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a count of at least 1")
    return value
