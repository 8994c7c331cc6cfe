"""What a dreamed frame costs beside the simulated one: one core, eight frames, at 128 x 96 and 320 x 240.

python -m benchmarks.vis_speed [--gpu]

Medians of repeated runs side by side in one process: physics alone, physics and TinyRenderer (colour, depth, classes), and
the lean model's chunk from arrays to frames. With --gpu, where there is one: the full-size network of Stable Video Diffusion
and a 30 M one at 640 x 480, 25 frames, untrained (timing needs no weights), with peak memory.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial

import gymnasium as gym
import numpy as np
import torch

from benchmarks.common import pin_threads
from embodiedreamer_gym.vis_aligner.clip import Condition, References
from embodiedreamer_gym.vis_aligner.lean import Lean
from embodiedreamer_gym.vis_aligner.lean_aligner import LeanAligner

FRAMES, REPEATS = 8, 9


def median(work: Callable[[], object]) -> float:
    """Median processor seconds, after one run to warm up."""
    work()
    times = []
    for _ in range(REPEATS):
        begun = time.process_time()
        work()
        times.append(time.process_time() - begun)
    return float(np.median(times))


def on_processor() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    env = gym.make("embodiedreamer_gym:EmbodieDreamer/PutCupOnMat-v0", obs_type="state", disable_env_checker=True)
    env.reset(seed=0)
    aloha, action = env.unwrapped, env.action_space.sample()
    aligner = LeanAligner(Lean())
    print(
        f"{FRAMES} frames, ms on one core, median of {REPEATS}\n{'':<12}{'physics':>10}{'and render':>12}{'dream':>10}"
    )
    for size in ((128, 96), (320, 240)):

        def steps(look: bool, size: tuple[int, int] = size) -> Condition:
            views = []
            for _ in range(FRAMES):
                aloha.step(action)
                views.append(aloha.capture("head", size) if look else None)
            if not look:
                return None  # pyright: ignore[reportReturnType]
            seen = ("rgb", "segmentation", "depth", "parts", "projections")
            return Condition(*(np.stack([getattr(v, k) for v in views]) for k in seen))

        condition = steps(True)
        references = References.start(condition.rgb[0], condition.part(0, 1))
        costs = [median(lambda: steps(False)), median(lambda: steps(True)),
                 median(partial(aligner.render, [references], [condition]))]  # fmt: skip
        print(
            f"{size[0]} x {size[1]:<6}"
            + "".join(f"{1e3 * c:>{w}.1f}" for c, w in zip(costs, (10, 12, 10), strict=True))
        )
    env.close()


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
