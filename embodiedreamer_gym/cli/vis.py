"""The verb `vis`: train, fine-tune, evaluate and run the video model, and make its references."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.terminal import check_counts

MODELS = ("lean", "svd")
LOWER = 0.3  # of the learning rate, for a model that has learnt already


def add_vis(verbs: Any) -> Any:
    """Add the verb and its actions; returns the latter, for more of them."""
    text = "the video model that gives simulated frames a real face"
    actions = verbs.add_parser("vis", help=text, description=text).add_subparsers(required=True, metavar="ACTION")
    for name, function, text in (
        ("train", _train, "train a model from nothing"),
        ("fine-tune", _fine_tune, "go on from a trained model with episodes of your own bench"),
        ("evaluate", _evaluate, "evaluate a model on held-out episodes, beside copying and raw simulation"),
        ("render", _render, "generate an episode, chunk by chunk, as a video"),
        ("bank", _bank, "make references for any scene from the first frames of episodes"),
        ("prepare", _prepare, "episodes to learn from, of real recordings with video: adds the simulator's view"),
    ):
        one = actions.add_parser(name, help=text, description=text)
        one.set_defaults(verb=function)
        one.add_argument("episodes", nargs="+", metavar="EPISODES", help="HDF5 files, folders, quoted globs")
        one.add_argument("--quiet", action="store_true", help="no progress")
        if name in ("train", "fine-tune"):
            _training_options(one, name)
        if name in ("fine-tune", "evaluate", "render"):
            one.add_argument(
                "--aligner", default="lean", metavar="A", help="lean, a file or folder (default %(default)s)"
            )
            one.add_argument("--diffusion-steps", type=int, default=1, metavar="N", help="default %(default)s")
        if name == "bank":
            text = "more episodes of the same bench, from anywhere in them"
            one.add_argument("--more", nargs="+", default=[], metavar="EPISODES", help=text)
        if name in ("evaluate", "render"):
            one.add_argument("--bank", metavar="B", help="what is known of the bench: lab, or a file")
        if name == "evaluate":
            one.add_argument("--chunks", type=int, metavar="N", help="of each episode (default: all)")
            one.add_argument("--json", type=Path, metavar="FILE", help="write the measures as JSON")
            one.add_argument("--strips", type=Path, metavar="DIR", help="write a picture strip of each episode")
        if name == "prepare":
            _prepare_options(one)
        if name in ("render", "bank"):
            kind = "FILE.mp4" if name == "render" else "FILE.npz"
            one.add_argument("--out", type=Path, required=True, metavar=kind, help="what to write")
    return actions


def _training_options(one: argparse.ArgumentParser, name: str) -> None:
    steps = 6000 if name == "train" else 1500
    one.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="model and checkpoint; goes on where it was"
    )
    one.add_argument("--steps", type=int, default=steps, metavar="N", help="of the optimiser (default %(default)s)")
    one.add_argument("--batch", type=int, default=2, metavar="B", help="clips of a step (default %(default)s)")
    one.add_argument("--seed", type=int, default=0, help="of all that is drawn (default 0)")
    if name == "train":
        one.add_argument("--model", choices=MODELS, default=MODELS[0], help="default: %(default)s")
        one.add_argument("--from", dest="source", metavar="DIR", help="svd: a local folder with unet and vae")


def _prepare_options(one: argparse.ArgumentParser) -> None:
    one.add_argument("--model", default="aloha", metavar="M", help="JSON file or built-in robot (default %(default)s)")
    one.add_argument("--cameras", type=Path, metavar="FILE", help="calibrated cameras (default: the built-in ones)")
    one.add_argument("--camera", default="head", metavar="NAME", help="whose video (default %(default)s)")
    one.add_argument("--masks", type=Path, metavar="DIR", help="DIR/<recording>/000000.png, ...: 0, 3 object, 4 goal")
    one.add_argument("--detector", type=Path, metavar="DIR", help="masks from words: a Grounding DINO, a local folder")
    one.add_argument("--segmenter", type=Path, metavar="DIR", help="and a SAM, a local folder")
    one.add_argument("--object", metavar="WORDS", help="what the object is, e.g. 'red cup'")
    one.add_argument("--goal", metavar="WORDS", help="what its goal is, e.g. 'blue mat'")
    one.add_argument("--size", default="128x96", metavar="WxH", help="of the pictures (default %(default)s)")
    one.add_argument("--out", type=Path, required=True, metavar="DIR", help="<recording>.hdf5, ...")


def _train(a: argparse.Namespace, progress: Any) -> None:
    import torch

    from embodiedreamer_gym.vis_aligner.lean import Lean
    from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner

    torch.manual_seed(a.seed)
    if a.model == "svd":
        from embodiedreamer_gym.vis_aligner.svd import load_svd

        if a.source is None:
            raise EmbodieDreamerError("vis train --model svd needs --from, a local folder with unet and vae.")
        aligner = load_svd(a.source)
    else:
        aligner = LeanAligner(Lean())
    _fit(a, aligner, 1.0, progress)


def _fine_tune(a: argparse.Namespace, progress: Any) -> None:
    _fit(a, _aligner(a), LOWER, progress)


def _fit(a: argparse.Namespace, aligner: Any, share: float, progress: Any) -> None:
    """Train and write the model."""
    from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes
    from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train

    check_counts(a, "steps", "batch")
    config = TrainingConfig(a.steps, a.batch, share * TrainingConfig.learning_rate, seed=a.seed)
    train(aligner, load_episodes(a.episodes), config, a.out, None if a.quiet else progress)
    print(f"{save_aligner(aligner, a.out)}: {aligner!r}")


def _evaluate(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.io.video import save_picture
    from embodiedreamer_gym.robot.files import write_json
    from embodiedreamer_gym.vis_aligner import metrics
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes
    from embodiedreamer_gym.vis_aligner.held_out import evaluate_aligner, tables

    aligner, results, bench = _aligner(a), [], _bench(a)
    episodes = load_episodes(a.episodes)
    for number, episode in enumerate(episodes):
        results.append(evaluate_aligner(aligner, episode, a.chunks, bench))
        if not a.quiet:
            progress(
                "evaluating", number + 1, len(episodes), psnr=f"{results[-1].measures['closed loop']['psnr']:.2f} dB"
            )
        if a.strips is not None:
            a.strips.mkdir(parents=True, exist_ok=True)
            save_picture(metrics.strip(results[-1].clips, zoom=2), a.strips / f"{episode.name}.png")
    print(tables(results))
    if a.json is not None:
        rows = [
            {"episode": j.episode.name, "measures": {k: m.as_dict() for k, m in j.measures.items()}} for j in results
        ]
        write_json({"aligner": repr(aligner), "episodes": rows}, a.json)


def _render(a: argparse.Namespace, progress: Any) -> None:
    import numpy as np

    from embodiedreamer_gym.io.video import write_video
    from embodiedreamer_gym.vis_aligner import generate
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes

    episodes = load_episodes(a.episodes)
    if len(episodes) != 1:
        raise EmbodieDreamerError(f"vis render takes one episode, not {len(episodes)}.")
    one = episodes[0]
    frames, _ = generate(_aligner(a), [one.references(0, _bench(a))], [one.condition.part(1, len(one))])
    write_video(np.concatenate([one.frames[:1], frames[0]]), a.out)
    print(a.out)


def _bank(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.vis_aligner import make_bank, save_bank
    from embodiedreamer_gym.vis_aligner.episodes import expand, load_episode, load_episodes, load_scene

    paths: Sequence[Path] = expand(a.episodes)
    scenes = [load_scene(path) for path in paths]
    more = load_episodes(a.more) if a.more else []
    bank = make_bank([load_episode(p) for p in paths], [s[1] for s in scenes], [s[0] for s in scenes], more)
    save_bank(bank, a.out)
    print(f"{a.out}: {bank!r}")


def _prepare(a: argparse.Namespace, progress: Any) -> None:
    from embodiedreamer_gym.envs.cameras import CAMERAS, load_cameras
    from embodiedreamer_gym.geometry.camera import read_size
    from embodiedreamer_gym.pipelines.prepare import prepare, write_episode
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.robot import RobotModel

    size = read_size(a.size)
    cameras = CAMERAS if a.cameras is None else load_cameras(a.cameras)
    if a.camera not in cameras:
        raise EmbodieDreamerError(f"there is no camera '{a.camera}'; there are {', '.join(cameras)}.")
    masks = _masks(a)
    model, recordings = RobotModel.load(a.model), load_recordings(*a.episodes)
    a.out.mkdir(parents=True, exist_ok=True)
    for recording in recordings:
        said = None if a.quiet else progress
        episode = prepare(recording, model, cameras[a.camera], size, masks(recording.name), said)
        write_episode(episode, a.out / f"{recording.name}.hdf5")
    print(f"{len(recordings)} episodes in {a.out}")


def _masks(a: argparse.Namespace) -> Callable[[str], Any]:
    """Where the objects are in the frames of a recording, by its name."""
    from embodiedreamer_gym.vis_aligner.grounded import grounded
    from embodiedreamer_gym.vis_aligner.masks import masks_in, no_masks

    words = {number: text for number, text in ((3, a.object), (4, a.goal)) if text}
    models = [path for path in (a.detector, a.segmenter) if path is not None]
    if (words or models) and (not words or len(models) != 2 or a.masks is not None):
        raise EmbodieDreamerError(
            "masks from words need --detector, --segmenter and --object or --goal, and no --masks; give all, or none."
        )
    if words:
        by_words = grounded(a.detector, a.segmenter, words)
        return lambda name: by_words
    return lambda name: no_masks if a.masks is None else masks_in(a.masks / name)


def _bench(a: argparse.Namespace) -> Any:
    from embodiedreamer_gym.vis_aligner import load_bank

    return None if a.bank is None else load_bank(a.bank).bench


def _aligner(a: argparse.Namespace) -> Any:
    from embodiedreamer_gym.vis_aligner import load_aligner

    return load_aligner(a.aligner, steps=a.diffusion_steps)
