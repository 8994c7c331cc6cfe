"""`embodiedreamer vis`: train, fine-tune, evaluate, render and bank."""

from embodiedreamer_gym.cli import options as o
from embodiedreamer_gym.errors import EmbodieDreamerError

EPISODES = o.option("episodes", "EPISODES", "HDF5 files, folders, quoted globs", o.REQUIRED, nargs="+")
ALIGNER = (
    o.option("--aligner", "A", "video model: lean, a file or folder", "lean"),
    o.option("--diffusion-steps", "N", "diffusion steps (default: 1 with lean, 4 with svd)", None, o.COUNT),
)
COMPUTING = (
    o.DEVICE,
    o.option("--bf16", None, "svd: compute in bfloat16"),
    o.option("--decode-chunk-size", "N", "svd: images decoded at once (default: 8)", None, o.COUNT),
)
CAMERA = o.option("--camera", "NAME", "camera of the episodes", "head")
BANK = o.option("--bank", "B", "bank of reference photos: lab, or a file")
TRAINING = (
    o.out_folder("output folder: model and checkpoint; an interrupted run resumes"),
    *COMPUTING,
    o.option("--gradient-checkpointing", None, "svd: use less memory, compute activations twice"),
    o.option("--batch", "B", "clips per step", 2, o.COUNT),
    o.SEED,
    o.QUIET,
)
FINE_TUNING = 0.3  # share of the learning rate for training from scratch


@o.verb(
    EPISODES,
    o.option("--steps", "N", "optimiser steps", 6000, o.COUNT),
    *TRAINING,
    o.option("--model", None, "model: lean or svd", "lean", choices=("lean", "svd")),
    o.option("--from", "DIR", "svd: local folder with unet and vae", dest="source"),
)
def train(a, progress):
    """Train a video model from scratch."""
    import torch

    from embodiedreamer_gym.vis_aligner.checkpoint import check_lean
    from embodiedreamer_gym.vis_aligner.lean import Lean
    from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner
    from embodiedreamer_gym.vis_aligner.svd import load_svd

    torch.manual_seed(a.seed)
    if a.model == "svd":
        if a.source is None:
            raise EmbodieDreamerError("vis train --model svd needs --from, a local folder with unet and vae.")
        return _fit(a, lambda device: load_svd(a.source, device=device, settings=_svd_settings(a)), 1.0, progress)
    check_lean(_svd_settings(a), "the new model")
    return _fit(a, lambda device: LeanAligner(Lean().to(device)), 1.0, progress)


@o.verb(EPISODES, *ALIGNER, o.option("--steps", "N", "optimiser steps", 1500, o.COUNT), *TRAINING)
def fine_tune(a, progress):
    """Fine-tune a trained model on episodes of your own bench."""
    return _fit(a, lambda device: _aligner(a, device), FINE_TUNING, progress)


def _fit(a, load, share: float, progress) -> str | None:
    """Train and write the model that `load` loads onto a device; share: factor on its learning rate."""
    from embodiedreamer_gym.learning.processes import find_processes
    from embodiedreamer_gym.vis_aligner.checkpoint import save_aligner
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes
    from embodiedreamer_gym.vis_aligner.training import TrainingConfig, train

    processes = find_processes(a.device)
    aligner = load(str(processes.device))
    config = TrainingConfig(a.steps, a.batch, share * aligner.learning_rate, seed=a.seed)
    train(aligner, load_episodes(a.episodes), config, a.out, progress, processes)
    return f"{save_aligner(aligner, a.out)}: {aligner!r}" if processes.first else None


@o.verb(
    EPISODES,
    *ALIGNER,
    *COMPUTING,
    BANK,
    CAMERA,
    o.option("--chunks", "N", "chunks per episode (default: all)", None, o.COUNT),
    o.JSON,
    o.option("--strips", "DIR", "write an image strip of each episode", None, o.output_folder),
    o.QUIET,
)
def evaluate(a, progress):
    """Evaluate a model on held-out episodes, with copied frames and the raw simulation as baselines."""
    from embodiedreamer_gym.io.video import save_picture
    from embodiedreamer_gym.vis_aligner import metrics
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes
    from embodiedreamer_gym.vis_aligner.held_out import evaluate_aligner, tables

    aligner, results, bank = _aligner(a), [], _bank(a)
    episodes = load_episodes(a.episodes, a.camera)
    for number, episode in enumerate(episodes):
        results.append(evaluate_aligner(aligner, episode, a.chunks, _bench(bank, episode)))
        psnr = results[-1].measures["closed loop"]["psnr"]
        progress("episodes evaluated", number + 1, len(episodes), PSNR=f"{psnr:.1f} dB")
        if a.strips is not None:
            a.strips.mkdir(parents=True, exist_ok=True)
            clips = {**results[-1].clips, "of no class": results[-1].marked()}
            save_picture(metrics.strip(clips, zoom=2), a.strips / f"{episode.name}.png")
    rows = [
        {
            "episode": j.episode.name,
            "unclassed_share": j.unclassed_share,
            "measures": {k: m.as_dict() for k, m in j.measures.items()},
        }
        for j in results
    ]
    return o.Result(tables(results), {"aligner": repr(aligner), "episodes": rows})


@o.verb(EPISODES, *ALIGNER, *COMPUTING, BANK, CAMERA, o.out_file("FILE.mp4", "video"), o.QUIET)
def render(a, progress):
    """Generate the frames of an episode and write them as a video."""
    import numpy as np

    from embodiedreamer_gym.io.video import write_video
    from embodiedreamer_gym.vis_aligner import generate
    from embodiedreamer_gym.vis_aligner.episodes import load_episodes

    if a.out.suffix != ".mp4":
        raise EmbodieDreamerError(f"{a.out} cannot be written; give a file name.mp4.")
    episodes = load_episodes(a.episodes, a.camera)
    if len(episodes) != 1:
        raise EmbodieDreamerError(f"vis render takes one episode, not {len(episodes)}.")
    one = episodes[0]
    aligner = _aligner(a)
    progress(f"{len(one)} frames")
    frames, _ = generate(aligner, [one.references(0, _bench(_bank(a), one))], [one.condition.part(1, len(one))])
    write_video(np.concatenate([one.frames[:1], frames[0]]), a.out)
    return a.out


@o.verb(
    EPISODES,
    o.option(
        "--more", "EPISODES", "further episodes of the same bench; any of their frames may be used", [], nargs="+"
    ),
    o.option(
        "--moving",
        "NAME",
        "cameras of the episodes that move with the robot, for instance on its wrists",
        [],
        nargs="+",
    ),
    o.option(
        "--moving-episodes",
        "EPISODES",
        "episodes of a camera on the robot that `vis prepare` wrote",
        [],
        nargs="+",
    ),
    o.option(
        "--photos",
        "EPISODES",
        "episodes of the same bench with larger pictures (2 to 4 times), from which the photos of robot and objects are taken",
        [],
        nargs="+",
    ),
    o.out_file("FILE.npz", "bank"),
    o.QUIET,
)
def bank(a, progress):
    """Create a bank of reference photos for any scene, from the first frames of episodes."""
    from embodiedreamer_gym.vis_aligner import make_bank, save_bank
    from embodiedreamer_gym.vis_aligner.episodes import expand, load_episode, load_episodes, load_scene

    paths = expand(a.episodes)
    scenes = [load_scene(path) for path in paths]
    more = load_episodes(a.more) if a.more else []
    moving = [one for camera in a.moving for one in load_episodes([*a.episodes, *a.more], camera)]
    moving += load_episodes(a.moving_episodes) if a.moving_episodes else []
    photos = load_episodes(a.photos) if a.photos else []
    episodes, poses, joints = [load_episode(p) for p in paths], [s[1] for s in scenes], [s[0] for s in scenes]
    made = make_bank(episodes, poses, joints, more, moving, photos)
    save_bank(made, a.out)
    return f"{a.out}: {made!r}"


def _bank(a):
    from embodiedreamer_gym.vis_aligner import load_bank

    return None if a.bank is None else load_bank(a.bank)


def _bench(bank, episode):
    """The part of a bank that matches an episode's camera, moving or fixed; None without a bank."""
    return None if bank is None else bank.moving if episode.condition.moving_camera else bank.bench


def _aligner(a, device: str | None = None):
    from embodiedreamer_gym.vis_aligner import load_aligner

    return load_aligner(a.aligner, a.diffusion_steps, device=device or a.device, svd=_svd_settings(a))


def _svd_settings(a):
    """Settings of svd from the options; None if none are given."""
    from embodiedreamer_gym.vis_aligner.svd_aligner import SvdSettings

    names = ("bf16", "gradient_checkpointing", "decode_chunk_size")
    given = {name: value for name in names if (value := getattr(a, name, None))}
    return SvdSettings(**given) if given else None
