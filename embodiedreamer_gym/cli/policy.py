"""The verb `policy`: train ACT on demonstrations, and evaluate a policy on seeds it has not seen."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import EmbodieDreamerError, PolicyError
from embodiedreamer_gym.io.terminal import check_counts, check_places, count
from embodiedreamer_gym.pipelines import FRAME_INTERVAL

PRESETS = {"small": 1e-3, "paper": 1e-5}  # peak learning rates
WIDEST = 160  # pixels
FIRST_SEED = 100_000  # of an evaluation, as in the benchmark of the experts


def add_policy(verbs: Any) -> Any:
    """Add the verb and its actions; returns them, for more to be added."""
    text = "policies: trained on demonstrations, evaluated in the environments"
    actions = verbs.add_parser("policy", help=text, description=text).add_subparsers(required=True, metavar="ACTION")
    _train_parser(actions)
    _evaluate_parser(actions)
    return actions


def _train_parser(actions: Any) -> None:
    text = "train ACT, the action chunking transformer, on episodes; an interrupted training goes on"
    one = actions.add_parser("train", help=text, description=text)
    one.set_defaults(verb=_train)
    one.add_argument("--data", type=Path, nargs="+", required=True, metavar="DIR",
                     help="ALOHA/AgileX HDF5 files or a LeRobot set; of several, all episodes")  # fmt: skip
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="policy, checkpoint and curves")
    one.add_argument("--steps", type=count, metavar="N", help="of the optimiser (default 8000 with masks, else 4000)")
    one.add_argument("--batch", type=count, metavar="B", help="starts of a step (default 64 with masks, else 32)")
    one.add_argument("--rate", type=float, metavar="R", help="peak learning rate (default: small 1e-3, paper 1e-5)")
    one.add_argument("--chunk", type=count, default=100, metavar="K", help="actions predicted (default %(default)s)")
    one.add_argument("--cameras", nargs="+", metavar="NAME", help="one to three (default: all of the data)")
    one.add_argument(
        "--size",
        metavar="WxH",
        help=f"to which pictures are scaled (default: as they are, but with the small preset at most {WIDEST} wide)",
    )
    one.add_argument("--mirror", metavar="M", help="learn each demonstration's mirror image too, of the other arm of this robot:"
                     " JSON file or built-in robot, symmetric as its cameras")  # fmt: skip
    one.add_argument(
        "--no-masks", action="store_true", help="do not learn from the objects' masks that the data may have"
    )
    one.add_argument("--asked", type=float, metavar="S", help="share of the starts near which a policy is asked that plays"
                     " whole chunks (default 0.7); 0 for one that is asked more often")  # fmt: skip
    one.add_argument("--no-rest", action="store_true", help="what follows an episode's end is not known: the robot is not to"
                     " learn to rest there")  # fmt: skip
    one.add_argument("--preset", choices=PRESETS, default="small", help="sizes of the network (default %(default)s)")
    one.add_argument("--device", default="cpu", metavar="D", help="cpu or cuda (default %(default)s)")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    one.add_argument("--quiet", action="store_true", help="no progress")


def _evaluate_parser(actions: Any) -> None:
    text = "play a policy on seeds it has not seen: success with its 95-percent interval, one row for each episode"
    one = actions.add_parser("evaluate", help=text, description=text)
    one.set_defaults(verb=_evaluate)
    one.add_argument("--policy", required=True, metavar="P",
                     help="a folder (of `policy train`, or a LeRobot ACT checkpoint), or package.module:function")  # fmt: skip
    one.add_argument("--task", required=True, metavar="ID", help="such as PutCupOnMat-v0")
    one.add_argument("--episodes", type=count, default=50, metavar="N", help="default: %(default)s")
    one.add_argument("--seed", type=int, default=FIRST_SEED, metavar="S", help="of the first one (default %(default)s)")
    one.add_argument("--execute", type=count, metavar="N", help="actions executed of each chunk (default: all)")
    one.add_argument("--ensemble", type=float, metavar="K", help="temporal ensembling; the paper's k is 0.01")
    one.add_argument("--robot", default="aloha", metavar="M", help="JSON file or built-in robot (default %(default)s)")
    one.add_argument("--size", metavar="WxH", help="of the pictures (default: as the policy learnt, or 128x96)")
    one.add_argument(
        "--dream", nargs="?", const="lean", metavar="ALIGNER", help="see through VisAligner (default: lean)"
    )
    one.add_argument("--bank", default="lab", metavar="B", help="references to dream from (default %(default)s)")
    one.add_argument("--every", type=count, metavar="N", help="dream after every N-th action and the last of a chunk"
                     f" (default {FRAME_INTERVAL}; with --video 1)")  # fmt: skip
    one.add_argument("--jobs", type=count, default=1, metavar="J", help="processes (default %(default)s)")
    one.add_argument("--json", type=Path, metavar="FILE", help="write the episodes as JSON")
    one.add_argument("--video", type=Path, metavar="DIR", help="write what the cameras saw, a video for each episode")
    one.add_argument("--quiet", action="store_true", help="no progress")


# ---- train -----------------------------------------------------------------------------------------------------


def _train(a: argparse.Namespace, progress: Any) -> None:
    import torch

    from embodiedreamer_gym.io.progress import Progress
    from embodiedreamer_gym.policies.act import TrainingConfig, train
    from embodiedreamer_gym.recordings.episodes import mixed, open_episodes

    if a.device == "cpu":
        torch.set_num_threads(1)  # two threads on two busy cores took seven times as long
    elif not torch.cuda.is_available():
        raise EmbodieDreamerError(f"--device {a.device} is not there; take cpu.")
    check_places(a.out, folders=True)
    sets = [open_episodes(one) for one in a.data]
    episodes = sets[0] if len(sets) == 1 else mixed(*sets, cameras=a.cameras)
    if len(sets) > 1 and not a.no_masks and not episodes.objects and any(one.objects for one in sets):
        print("the sets do not have masks of the same objects; learning without masks", file=sys.stderr)
    config = _config(a, episodes)
    said = Progress(a.quiet)
    rate = PRESETS[a.preset] if a.rate is None else a.rate
    mirror = () if a.mirror is None else _mirror(a.mirror)
    settings = TrainingConfig.usual(config, steps=a.steps, batch=a.batch, learning_rate=rate, mirror=mirror,
                                    chunk_start_share=a.asked, rest=not a.no_rest, seed=a.seed)  # fmt: skip
    try:
        policy = train(episodes, config, settings, a.out, said, lambda text: print(text, file=sys.stderr), a.device)
    finally:
        said.close()
    print(f"{a.out}: {policy!r}")


def _mirror(robot: str) -> tuple[int, ...]:
    from embodiedreamer_gym.envs.robots import load_robot
    from embodiedreamer_gym.robot.mirror import mirrored_joints

    return mirrored_joints(load_robot(robot))


def _config(a: argparse.Namespace, episodes: Any) -> Any:
    """The network's sizes, of the options and the episodes."""
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.policies.act import ActConfig, check_cameras, picture_size, with_object_poses

    cameras = tuple(a.cameras or episodes.cameras)
    check_cameras(episodes, cameras)
    if not cameras:
        raise PolicyError(f"the episodes in {a.data[0]} have no pictures, and ACT needs those of one camera at least.")
    found = picture_size(episodes, cameras[0])
    size = _shrunk(found, a.preset) if a.size is None else read_size(a.size)
    if a.size is None and size != found:
        print(
            f"pictures of {found[0]}x{found[1]} are scaled to {size[0]}x{size[1]}; --size says otherwise",
            file=sys.stderr,
        )
    config = ActConfig(episodes.state_size, episodes.action_size, cameras, size)
    config = config.paper() if a.preset == "paper" else config if a.no_masks else with_object_poses(config, episodes)
    return config.with_(chunk=a.chunk, source_size=None if found == size else found)


def _shrunk(size: tuple[int, int], preset: str) -> tuple[int, int]:
    """A size that the small preset learns from in minutes; at 640 x 480 its attention takes gigabytes."""
    width, height = size
    if preset != "small" or width <= WIDEST:
        return size
    return WIDEST, max(1, round(height * WIDEST / width))


# ---- evaluate --------------------------------------------------------------------------------------------------


def _evaluate(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs import task_id
    from embodiedreamer_gym.io.parallel import many
    from embodiedreamer_gym.io.progress import Progress
    from embodiedreamer_gym.policies.evaluation import Evaluation, executed
    from embodiedreamer_gym.robot.files import write_json

    if a.dream is not None and (a.ensemble is not None or a.size is not None):
        raise EmbodieDreamerError(
            "--dream shows whole chunks at the size of the bank's photos; leave out --ensemble and --size."
        )
    task, policy = task_id(a.task), _policy(a)
    actions = executed(policy, a.execute)
    check_counts(a, "seed", least=0)
    check_places(a.json)
    check_places(a.video, folders=True)
    said, rows = Progress(a.quiet), []
    seeds = range(a.seed, a.seed + a.episodes)

    def told(row: Any) -> None:
        rows.append(row)
        said("evaluating", len(rows), a.episodes, successes=sum(row.success for row in rows))

    def told_all(number: int, found: list[Any]) -> None:
        for row in found:
            told(row)

    try:
        if a.jobs == 1:
            _play(a, policy, tuple(seeds), told)
        else:  # some episodes for each call, which builds its world anew
            step = max(1, min(8, a.episodes // a.jobs))
            calls = [(a, None, tuple(seeds[k : k + step])) for k in range(0, a.episodes, step)]
            many(_play, calls, a.jobs, told_all)
    finally:
        said.close()
    found = Evaluation(task, actions, tuple(rows))
    print(found)
    if a.json is not None:
        write_json({"policy": str(a.policy), "robot": str(a.robot), "dream": a.dream, **found.as_dict()}, a.json)


def _play(a: argparse.Namespace, policy: Any, seeds: tuple[int, ...], told: Any = None) -> list[Any]:
    """Results of some seeds; runs in a process of its own where there are several, and then loads the policy there."""
    import torch

    from embodiedreamer_gym.policies.evaluation import evaluate

    torch.set_num_threads(1)
    policy = _policy(a) if policy is None else policy
    env = _environment(a, policy)
    films: dict[int, list[Any]] = {}

    def watch(seed: int) -> Any:
        frames = films.setdefault(seed, [])
        return lambda observation, info: frames.extend(_shown(observation, info))

    def done(row: Any) -> None:
        if a.video is not None:
            _write(films.pop(row.seed), a.video, row, env.unwrapped.metadata["render_fps"])
        if told is not None:
            told(row)

    try:
        return list(evaluate(policy, env, seeds, a.execute, watch if a.video else None, done).episodes)
    finally:
        env.close()


def _environment(a: argparse.Namespace, policy: Any) -> Any:
    """The task's environment with the policy's cameras, its pictures as large as those it learnt from, or dreamed."""
    import gymnasium

    from embodiedreamer_gym.envs import task_id
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.policies.protocol import picture_inputs

    if a.dream is not None:
        from embodiedreamer_gym.pipelines.policy_env import policy_world

        every = a.every or (1 if a.video else FRAME_INTERVAL)
        return policy_world(policy, a.task, a.robot, a.execute, a.dream, a.bank, every)
    cameras, learnt = picture_inputs(policy)
    size = learnt if a.size is None else read_size(a.size)
    return gymnasium.make(task_id(a.task), cameras=cameras, image_size=size, robot=a.robot)


def _policy(a: argparse.Namespace) -> Any:
    """The policy of the options."""
    from embodiedreamer_gym.policies import load_policy

    policy = load_policy(a.policy)
    if a.ensemble is not None:
        from embodiedreamer_gym.policies.act import TemporalEnsemble

        return TemporalEnsemble(policy, a.ensemble)
    return policy


def _shown(observation: Any, info: Any) -> Any:
    """The frames of a dreamed chunk, or one picture of all cameras, side by side."""
    import numpy as np

    if "frames" in info:
        return info["frames"][: info["filmed"]]
    pixels = observation["pixels"]
    return [np.concatenate(list(pixels.values()), 1) if isinstance(pixels, dict) else pixels]


def _write(frames: list[Any], folder: Path, row: Any, rate: float) -> None:
    """Write an episode's video."""
    import numpy as np

    from embodiedreamer_gym.io.video import write_video

    folder.mkdir(parents=True, exist_ok=True)
    write_video(np.stack(frames), folder / f"seed_{row.seed}_{'success' if row.success else 'failure'}.mp4", rate)
