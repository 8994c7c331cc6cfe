"""`embodiedreamer vis`: train, fine-tune, evaluate, render and bank."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from embodiedreamer_gym.cli.options import COUNT, JSON, QUIET, REQUIRED, SEED, option, out_file, out_folder
from embodiedreamer_gym.errors import EmbodieDreamerError
from embodiedreamer_gym.io.files import check_outputs, write_json

EPISODES = option("episodes", "EPISODES", "HDF5 files, folders, quoted globs", REQUIRED, nargs="+")
ALIGNER = (
    option("--aligner", "A", "video model: lean, a file or folder", "lean"),
    option("--diffusion-steps", "N", "of svd", 1, COUNT),
)
BANK = option("--bank", "B", "what is known of the bench: lab, or a file")
TRAINING = (
    out_folder("model and checkpoint; goes on where it was"),
    option("--batch", "B", "clips of a step", 2, COUNT),
    SEED,
    QUIET,
)
LOWER = 0.3  # of the learning rate, for a model that has learnt already


def _train(a, progress) -> None:
    import torch

    from embodiedreamer_gym.vis_aligner.lean import Lean
    from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
    from embodiedreamer_gym.vis_aligner.svd import load_svd

    torch.manual_seed(a.seed)
    if a.model == "svd" and a.source is None:
        raise EmbodieDreamerError("vis train --model svd needs --from, a local folder with unet and vae.")
    _fit(a, load_svd(a.source) if a.model == "svd" else LeanAligner(Lean()), 1.0, progress)


def _fine_tune(a, progress) -> None:
    _fit(a, _aligner(a), LOWER, progress)


def _fit(a, aligner: Any, share: float, progress) -> None:
    """Train and write the model."""
    from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes
    from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train

    check_outputs(folders=[a.out])
    config = TrainingConfig(a.steps, a.batch, share * TrainingConfig.learning_rate, seed=a.seed)
    train(aligner, load_episodes(a.episodes), config, a.out, progress)
    progress.close()
    print(f"{save_aligner(aligner, a.out)}: {aligner!r}")


def _evaluate(a, progress) -> None:
    from embodiedreamer_gym.io.video import save_picture
    from embodiedreamer_gym.vis_aligner import metrics
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes
    from embodiedreamer_gym.vis_aligner.held_out import evaluate_aligner, tables

    check_outputs(a.json, folders=[a.strips])
    aligner, results, bench = _aligner(a), [], _bench(a)
    episodes = load_episodes(a.episodes)
    for number, episode in enumerate(episodes):
        results.append(evaluate_aligner(aligner, episode, a.chunks, bench))
        psnr = results[-1].measures["closed loop"]["psnr"]
        progress("episodes evaluated", number + 1, len(episodes), PSNR=f"{psnr:.1f} dB")
        if a.strips is not None:
            a.strips.mkdir(parents=True, exist_ok=True)
            save_picture(metrics.strip(results[-1].clips, zoom=2), a.strips / f"{episode.name}.png")
    progress.close()
    print(tables(results))
    if a.json is not None:
        rows = [
            {"episode": j.episode.name, "measures": {k: m.as_dict() for k, m in j.measures.items()}} for j in results
        ]
        write_json({"aligner": repr(aligner), "episodes": rows}, a.json)


def _render(a, progress) -> None:
    import numpy as np

    from embodiedreamer_gym.io.video import write_video
    from embodiedreamer_gym.vis_aligner import generate
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes

    check_outputs(a.out)
    if a.out.suffix != ".mp4":
        raise EmbodieDreamerError(f"{a.out} cannot be written; give a file name.mp4.")
    episodes = load_episodes(a.episodes)
    if len(episodes) != 1:
        raise EmbodieDreamerError(f"vis render takes one episode, not {len(episodes)}.")
    one = episodes[0]
    progress(f"{len(one)} frames")
    frames, _ = generate(_aligner(a), [one.references(0, _bench(a))], [one.condition.part(1, len(one))])
    write_video(np.concatenate([one.frames[:1], frames[0]]), a.out)
    progress.close()
    print(a.out)


def _make_bank(a, progress) -> None:
    from embodiedreamer_gym.vis_aligner import make_bank, save_bank
    from embodiedreamer_gym.vis_aligner.episodes import expand, load_episode, load_episodes, load_scene

    check_outputs(a.out)
    paths = expand(a.episodes)
    scenes = [load_scene(path) for path in paths]
    more = load_episodes(a.more) if a.more else []
    bank = make_bank([load_episode(p) for p in paths], [s[1] for s in scenes], [s[0] for s in scenes], more)
    save_bank(bank, a.out)
    progress.close()
    print(f"{a.out}: {bank!r}")


def _bench(a) -> Any:
    from embodiedreamer_gym.vis_aligner import load_bank

    return None if a.bank is None else load_bank(a.bank).bench


def _aligner(a) -> Any:
    from embodiedreamer_gym.vis_aligner import load_aligner

    return load_aligner(a.aligner, steps=a.diffusion_steps)


TRAIN = SimpleNamespace(run=_train, TEXT="train a video model from nothing", OPTIONS=(
    EPISODES, option("--steps", "N", "of the optimiser", 6000, COUNT), *TRAINING,
    option("--model", None, "lean or svd (default: %(default)s)", "lean", choices=("lean", "svd")),
    option("--from", "DIR", "svd: a local folder with unet and vae", dest="source"),
))  # fmt: skip
FINE_TUNE = SimpleNamespace(run=_fine_tune, TEXT="go on from a trained model with episodes of your own bench", OPTIONS=(
    EPISODES, *ALIGNER, option("--steps", "N", "of the optimiser", 1500, COUNT), *TRAINING,
))  # fmt: skip
EVALUATE = SimpleNamespace(run=_evaluate, TEXT="compare a model with held-out episodes, copying and raw simulation", OPTIONS=(
    EPISODES, *ALIGNER, BANK, option("--chunks", "N", "of each episode (default: all)", None, COUNT), JSON,
    option("--strips", "DIR", "write a picture strip of each episode", None, Path), QUIET,
))  # fmt: skip
RENDER = SimpleNamespace(run=_render, TEXT="generate the frames of an episode, chunk by chunk, as a video", OPTIONS=(
    EPISODES, *ALIGNER, BANK, out_file("FILE.mp4", "video"), QUIET,
))  # fmt: skip
MAKE_BANK = SimpleNamespace(run=_make_bank, TEXT="make references for any scene from the first frames of episodes", OPTIONS=(
    EPISODES, option("--more", "EPISODES", "more episodes of the same bench, from anywhere in them", [], nargs="+"),
    out_file("FILE.npz", "bank"), QUIET,
))  # fmt: skip
