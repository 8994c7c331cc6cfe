"""Benefit of generating at a larger size, compared with resizing smaller generated frames.

python -m benchmarks.vis_size FILMS --bank FILMS [--more FILMS] [--size 128x96] [--chunks N]

FILMS: episodes of `embodiedreamer standin film`. Each episode is generated at its own size, and again from inputs,
photos and bench of the smaller size, with the frames resized (bicubic). Both are compared with the true frames at the
larger size, after true frames and in the closed loop.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from benchmarks.common import pin_threads
from embodiedreamer_gym.geometry.camera import read_size
from embodiedreamer_gym.vis_aligner import Aligner, Episode, load_aligner, load_episodes
from embodiedreamer_gym.vis_aligner.bench import make_bench
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.condition import Condition
from embodiedreamer_gym.vis_aligner.held_out import AFTER_TRUE, CLOSED, evaluate_aligner
from embodiedreamer_gym.vis_aligner.metrics import GroundTruth, evaluate_all

COLUMNS = ("psnr", "ssim", "psnr.moving", "psnr.arm and objects", "psnr.objects", "iou.objects")


def smaller(episode: Episode, size: tuple[int, int]) -> Episode:
    """An episode at a smaller image size, for both camera and simulator."""
    seen, (width, height) = episode.condition, episode.condition.size
    x, y = size[0] / width, size[1] / height
    scale = np.array([[x, 0, 0.5 * x - 0.5], [0, y, 0.5 * y - 0.5], [0, 0, 1]], np.float32)
    view = Condition(
        resized(seen.rgb, size, cv2.INTER_AREA), resized(seen.classes, size, cv2.INTER_NEAREST_EXACT),
        None if seen.depth is None else resized(seen.depth, size, cv2.INTER_NEAREST_EXACT),
        None if seen.parts is None else resized(seen.parts, size, cv2.INTER_NEAREST_EXACT),
        None if seen.projections is None else scale @ seen.projections, seen.hulls,
    )  # fmt: skip
    clean = None if episode.clean is None else resized(episode.clean, size, cv2.INTER_AREA)
    return replace(episode, frames=resized(episode.frames, size, cv2.INTER_AREA), condition=view, clean=clean)


def resized(pictures: np.ndarray, size: tuple[int, int], how: int) -> np.ndarray:
    """Pictures (T, H, W, ...) resized to another width and height; how: OpenCV's interpolation."""
    return np.stack([cv2.resize(one, size, interpolation=how) for one in pictures])


def compare(aligner: Aligner, episode: Episode, size: tuple[int, int], chunks: int | None, benches: Sequence[Bench]) -> dict[str, list[float]]:  # fmt: skip
    """Measures of an episode's clips at its own size, by name; benches: for its own size and for the smaller one."""
    own = evaluate_aligner(aligner, episode, chunks, benches[0])
    fewer = evaluate_aligner(aligner, smaller(episode, size), chunks, benches[1])
    clips = {f"{name}, {label}": clip for label, made in (("own size", own.clips), ("resized", fewer.clips))
             for name, clip in made.items() if name in (AFTER_TRUE, CLOSED)}  # fmt: skip
    clips = {name: resized(clip, episode.condition.size, cv2.INTER_CUBIC) for name, clip in clips.items()}
    count, classes = len(own.clips[CLOSED]), episode.condition.classes
    shown = slice(1, count + 1)
    clips["truth at the smaller size, resized"] = resized(
        smaller(episode, size).frames[shown], episode.condition.size, cv2.INTER_CUBIC
    )
    truth = GroundTruth(episode.frames[shown], classes[shown], episode.frames[0], classes[0], episode.class_names)
    found = evaluate_all(clips, truth, episode.condition.rgb[shown], chunk=aligner.chunk)
    return {name: [np.nan if one[c] is None else float(one[c]) for c in COLUMNS] for name, one in found.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.vis_size", description=str(__doc__).splitlines()[0])
    parser.add_argument("films", nargs="+")
    parser.add_argument("--bank", nargs="+", required=True, help="films of the same bench")
    parser.add_argument("--size", type=read_size, default=(128, 96), metavar="WxH", help="the smaller size")
    parser.add_argument("--chunks", type=int, help="chunks of each episode (default: all)")
    parser.add_argument("--aligner", default="lean")
    a = parser.parse_args(arguments)
    pin_threads()
    torch.set_num_threads(1)
    known = load_episodes([Path(name) for name in a.bank])
    benches = [make_bench(known), make_bench([smaller(e, a.size) for e in known])]
    rows = [compare(load_aligner(a.aligner), e, a.size, a.chunks, benches) for e in load_episodes(a.films)]
    print(f"{len(rows)} episodes\n| | {' | '.join(COLUMNS)} |\n|{'---|' * (len(COLUMNS) + 1)}")
    for name in rows[0]:
        mean = np.nanmean([row[name] for row in rows], axis=0)
        print(f"| {name} | " + " | ".join(f"{value:.2f}" for value in mean) + " |")


if __name__ == "__main__":
    main()
