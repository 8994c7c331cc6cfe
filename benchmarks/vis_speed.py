"""Cost of generated frames compared with simulated ones: one core, eight frames, at 128 x 96 and 320 x 240.

python -m benchmarks.vis_speed
python -m benchmarks.vis_speed --device cuda

Over a whole episode, in one process: only physics, physics and TinyRenderer (colour, depth, parts), and a chunk of the
shipped model, from arrays to frames. With --device: seconds and peak memory of Stable Video Diffusion at full size, 25
frames of 640 x 480 at four steps, of one view and of three, from arrays to frames; and frames per second of the shipped
model.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from benchmarks.common import pin_threads, save
from benchmarks.svd_networks import svd_networks
from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.learning.device import find_device
from embodiedreamer_gym.vis_aligner import Aligner, Condition, Episode, References, load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.bench import make_bench
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.light import Light
from embodiedreamer_gym.vis_aligner.network_inputs import Inputs, reprojected_frames
from embodiedreamer_gym.vis_aligner.svd_aligner import SvdAligner, SvdSettings

FRAMES, REPEATS, STEPS = 8, 9, 201
SVD_STEPS, REPEATS_SVD, MIDDLE = 4, 3, 60


def on_processor() -> list[dict[str, object]]:
    """Print the table and return its rows; times in ms per chunk."""
    rows: list[dict[str, object]] = []
    torch.set_num_threads(1)
    print(f"{FRAMES} frames of an expert's episode, ms of one core\n"
          f"{'':<12}{'physics':>10}{'and render':>12}{'video, median':>15}{'mean':>8}{'slowest':>10}{'light only':>12}")  # fmt: skip
    for size in ((128, 96), (320, 240)):
        physics, _ = episode(None)
        both, condition = episode(size)
        assert condition is not None
        aligner = load_aligner("lean")
        bench = load_bank("lab").bench
        if bench is None or bench.seen.shape != size[::-1]:  # any bench serves for timing
            bench = make_bench([Episode("any", condition.rgb, condition)])
        light = bench.light or scaled(load_bank("lab").bench, size)
        bench, shades = replace(bench, light=light), []
        references, times = [References.start(condition.rgb[0], condition.part(0, 1), bench)], []
        for start in range(1, len(condition) - FRAMES, FRAMES):
            part = condition.part(start, start + FRAMES)
            begun = time.process_time()
            part = references[0].lit(part)
            shades.append(1e3 * (time.process_time() - begun))
            frames = aligner.render(references, [part])
            references = [references[0].after(frames[0], part)]
            times.append(1e3 * (time.process_time() - begun))
        print(f"{size[0]} x {size[1]:<6}{physics:>10.1f}{both:>12.1f}{np.median(times):>15.1f}{np.mean(times):>8.1f}"
              f"{max(times[1:]):>10.1f}{np.median(shades):>10.1f}")  # fmt: skip
        rows.append({"size": list(size), "physics_ms": physics, "render_ms": both, "video_ms": float(np.median(times))})
    return rows


def scaled(bench: Bench | None, size: tuple[int, int]) -> Light | None:
    """The light of a bench for pictures of another size (width, height)."""
    if bench is None or bench.light is None:
        return None
    x, y = size[0] / bench.light.size[0], size[1] / bench.light.size[1]
    matrix = np.array([[x, 0, 0.5 * x - 0.5], [0, y, 0.5 * y - 0.5], [0, 0, 1.0]]) @ bench.light.matrix
    return replace(bench.light, receivers=np.ones(size[::-1], bool), matrix=matrix)


def episode(size: tuple[int, int] | None, steps: slice = slice(STEPS)) -> tuple[float, Condition | None]:
    """Milliseconds per chunk of an expert's episode, and its pictures; size: None for none; steps: steps to render."""
    env = AlohaEnv("PutCupOnMat", obs_type="state", renderer="tiny")
    env.reset(seed=0)
    expert, views, spent = ScriptedExpert(env), [], 0.0
    for step in range(steps.stop):
        action = expert.act()
        begun = time.process_time()
        env.step(action)
        if size is not None and step >= (steps.start or 0):
            views.append(env.capture("head", size))
        spent += time.process_time() - begun
    env.close()
    return 1e3 * spent / steps.stop * FRAMES, Condition(**stacked(views)) if views else None


def on_device(device: str, tiny: bool = False, size: tuple[int, int] = (640, 480), frames: int = 25) -> None:
    """Print seconds and peak memory of svd (untrained, which takes the same time), and frames per second of lean.

    tiny: use a network of a few million parameters; frames: frames of a clip, including the reference.
    """
    where = find_device(device)
    torch.set_num_threads(1)  # of the processor's part
    print(f"\n{where}, torch {torch.__version__}, svd {'tiny' if tiny else 'at full size'} in bfloat16")
    count = frames - 1
    condition = view(size, frames)
    references = start(condition)
    with where:  # 1.5 billion random weights take a minute on one core
        unet, vae = (network.to(where).eval() for network in svd_networks(tiny, frames))  # some weights ignore `with`
    svd = SvdAligner(unet, vae, count, SVD_STEPS, settings=SvdSettings(bf16=True))
    for views in (1, 3):
        if where.type == "cuda":
            torch.cuda.reset_peak_memory_stats(where)
        begun = time.perf_counter()
        for _ in range(REPEATS_SVD):
            reprojected_frames(references, condition.part(1, frames), Inputs())
        put_together = views * (time.perf_counter() - begun) / REPEATS_SVD
        spent = repeated(svd, references, condition, count, views, REPEATS_SVD)
        peak = torch.cuda.max_memory_allocated(where) / 1e9 if where.type == "cuda" else float("nan")
        print(f"svd, {frames} frames of {size[0]} x {size[1]} at {SVD_STEPS} steps, {views} view(s) at once: "
              f"{spent:.2f} s, of which {put_together:.2f} s on the processor; peak memory {peak:.1f} GB (target for "
              "one view: 3 s, 40 GB)")  # fmt: skip
    condition = view((128, 96), FRAMES + 1)
    references = start(condition)
    for clips in (1, 8, 32):
        spent = repeated(load_aligner("lean", device=device), references, condition, FRAMES, clips, REPEATS)
        print(
            f"lean, {clips} clip(s) of {FRAMES} frames of 128 x 96 at once: {clips * FRAMES / spent:.0f} frames/s (target 300)"
        )


def repeated(
    aligner: Aligner, references: References, condition: Condition, count: int, clips: int, repeats: int
) -> float:
    """Median seconds for a batch of the same chunk, from arrays to frames, after one untimed warm-up."""
    times = []
    for _ in range(repeats + 1):
        if isinstance(aligner, SvdAligner):
            aligner.latents.clear()
        begun = time.perf_counter()
        aligner.render([references] * clips, [condition.part(1, count + 1)] * clips)
        times.append(time.perf_counter() - begun)
    return float(np.median(times[1:]))


def start(condition: Condition) -> References:
    """References from the first frame of a condition, with a bench (background, photos of the parts, light) made of it."""
    bench = make_bench([Episode("any", condition.rgb, condition)])
    return References.start(condition.rgb[0], condition.part(0, 1), bench)


def view(size: tuple[int, int], frames: int) -> Condition:
    """Frames from the middle of an expert's episode."""
    _, condition = episode(size, slice(MIDDLE, MIDDLE + frames))
    assert condition is not None
    return condition


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.vis_speed", description=str(__doc__).splitlines()[0])
    parser.add_argument("--device", help="time svd and lean on this device, instead of lean on one core")
    parser.add_argument("--tiny", action="store_true", help="a tiny svd in place of the full-size one")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="times on one core as JSON")
    a = parser.parse_args(arguments)
    if a.device is not None:
        on_device(a.device, a.tiny)
        return
    pin_threads()
    save(on_processor(), a.out)


if __name__ == "__main__":
    main()
