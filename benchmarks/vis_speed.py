"""What a generated frame costs beside the simulated one: one core, eight frames, at 128 x 96 and 320 x 240.

python -m benchmarks.vis_speed [--gpu]

Over a whole episode, in one process: physics alone, physics and TinyRenderer (colour, depth, parts), and the shipped model's
chunk from arrays to frames. With --gpu, where there is one: the full-size network of Stable Video Diffusion
and a 30 M one at 640 x 480, 25 frames, untrained (timing needs no weights), with peak memory.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from benchmarks.common import pin_threads
from embodiedreamer_gym.engines.frame import stacked
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.experts import ScriptedExpert
from embodiedreamer_gym.vis_aligner import Condition, Episode, References, load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.bench import make_bench
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.light import Light

FRAMES, REPEATS, STEPS = 8, 9, 201


def on_processor() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    print(f"{FRAMES} frames of an expert's episode, ms of one core\n{'':<12}{'physics':>10}{'and render':>12}{'video, median':>15}"
          f"{'mean':>8}{'slowest':>10}{'of it light':>12}")  # fmt: skip
    for size in ((128, 96), (320, 240)):
        physics, _ = episode(None)
        both, condition = episode(size)
        assert condition is not None
        aligner = load_aligner("lean")
        bench = load_bank("lab").bench
        if bench is None or bench.seen.shape != size[::-1]:  # any will do
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


def scaled(bench: Bench | None, size: tuple[int, int]) -> Light | None:
    """The light of a bench for pictures of another size (width, height)."""
    if bench is None or bench.light is None:
        return None
    x, y = size[0] / bench.light.size[0], size[1] / bench.light.size[1]
    matrix = np.array([[x, 0, 0.5 * x - 0.5], [0, y, 0.5 * y - 0.5], [0, 0, 1.0]]) @ bench.light.matrix
    return replace(bench.light, receivers=np.ones(size[::-1], bool), matrix=matrix)


def episode(size: tuple[int, int] | None) -> tuple[float, Condition | None]:
    """Milliseconds per chunk of an expert's episode with or without its pictures, and these."""
    env = AlohaEnv("PutCupOnMat", obs_type="state", renderer="tiny")
    env.reset(seed=0)
    expert, views, spent = ScriptedExpert(env), [], 0.0
    for _ in range(STEPS):
        action = expert.act()
        begun = time.process_time()
        env.step(action)
        if size is not None:
            views.append(env.capture("head", size))
        spent += time.process_time() - begun
    env.close()
    return 1e3 * spent / STEPS * FRAMES, Condition(**stacked(views)) if views else None


def on_gpu() -> None:
    """Print frames per second and peak memory of both sizes of network."""
    from diffusers import UNetSpatioTemporalConditionModel

    if not torch.cuda.is_available():
        print("no GPU here: nothing is measured.")
        return
    for label, widths, heads in (
        ("full size", (320, 640, 1280, 1280), (5, 10, 20, 20)),
        ("30 M", (64, 96, 160), (4, 6, 8)),
    ):
        kinds = len(widths)
        unet = UNetSpatioTemporalConditionModel(
            in_channels=8, block_out_channels=widths, num_attention_heads=heads, num_frames=25,
            layers_per_block=2 if kinds == 4 else 1, cross_attention_dim=1024 if kinds == 4 else 64,
            down_block_types=("CrossAttnDownBlockSpatioTemporal",) * (kinds - 1) + ("DownBlockSpatioTemporal",),
            up_block_types=("UpBlockSpatioTemporal",) + ("CrossAttnUpBlockSpatioTemporal",) * (kinds - 1),
        ).half().cuda().eval()  # fmt: skip
        noisy = torch.randn(1, 25, 8, 60, 80, device="cuda", dtype=torch.half)
        context = torch.zeros(1, 1, unet.config.cross_attention_dim, device="cuda", dtype=torch.half)
        micro = torch.zeros(1, 3, device="cuda", dtype=torch.half)
        torch.cuda.reset_peak_memory_stats()
        with torch.inference_mode():
            times = []
            for _ in range(REPEATS + 2):
                torch.cuda.synchronize()
                begun = time.perf_counter()
                unet(noisy, 1000.0, encoder_hidden_states=context, added_time_ids=micro)
                torch.cuda.synchronize()
                times.append(time.perf_counter() - begun)
        millions = sum(p.numel() for p in unet.parameters()) / 1e6
        print(f"{label}: {millions:.0f} M parameters, {25 / np.median(times[2:]):.0f} frames/s a step without decoder, "
              f"peak {torch.cuda.max_memory_allocated() / 2**30:.1f} GiB")  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.vis_speed", description=str(__doc__).splitlines()[0])
    parser.add_argument("--gpu", action="store_true")
    a = parser.parse_args(arguments)
    pin_threads()
    on_processor()
    if a.gpu:
        on_gpu()


if __name__ == "__main__":
    main()
