"""Wrist cameras: frames assembled without a network, on films that were not used for the bank.

python -m benchmarks vis_wrists --films DIR [--bank B] [--out FILE]

Films of the stand-in bench from both wrist cameras are rendered (Blender's Cycles, a Python with bpy; about 20 minutes
on one core; existing films in DIR are kept). The closed loop, frames after true frames, and a copy of the last true
frame are compared with the films. A camera whose arm does not move is left out, because there a copy is perfect.
--remake: make and use DIR/wrists.npz, the shipped bank with a wrist part made from the films `wrists`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import save
from embodiedreamer_gym.cli.command import main as embodiedreamer
from embodiedreamer_gym.io.video import save_picture
from embodiedreamer_gym.vis_aligner import Episode, load_aligner, load_bank, load_episodes, metrics, save_bank
from embodiedreamer_gym.vis_aligner.clip import Bench
from embodiedreamer_gym.vis_aligner.held_out import AFTER_TRUE, CLOSED, HeldOutResult, evaluate_aligner
from embodiedreamer_gym.vis_aligner.moving_bench import make_moving_bench

CAMERAS = ("left_wrist", "right_wrist")
FILMS = {"wrists": ("--episodes", "2", "--every", "10", "--seed", "77"),
         "wrists_test": ("--episodes", "2", "--frames", "41", "--seed", "502")}  # fmt: skip
MOVES = 0.01  # a camera counts as moving if a larger share of pixels changes class after the first frame
ROWS = ("copy last", AFTER_TRUE, CLOSED)


def films(folder: Path) -> None:
    """Render the missing films.

    Raises: SystemExit where rendering fails.
    """
    for name, options in FILMS.items():
        command = ["standin", "film", "--task", "all", "--camera", *CAMERAS, "--out", str(folder / name), *options]
        if code := embodiedreamer(command):
            raise SystemExit(code)


def moving(name: str, folder: Path) -> list[Episode]:
    """The episodes of cameras whose arm moves."""
    found = [e for camera in CAMERAS for e in load_episodes([folder / name], camera)]
    return [e for e in found if (e.condition.classes != e.condition.classes[:1]).mean() > MOVES]


def judge(episode: Episode, bench: Bench | None) -> tuple[dict[str, Any], HeldOutResult]:
    """Figures of one episode (PSNR in dB of each method, milliseconds of processor time per frame), and its result."""
    aligner, length = load_aligner("assembled"), (len(episode) - 1) // 8 * 8 + 1
    first = replace(episode, frames=episode.frames[:length], condition=episode.condition.part(0, length), clean=None)
    result = evaluate_aligner(aligner, first, bench=bench)
    references, begun = first.references(0, bench), time.process_time()
    for at in range(1, length, aligner.chunk):
        view = first.condition.part(at, at + aligner.chunk)
        references = references.after(aligner.render([references], [view])[0], view)
    spent = 1e3 * (time.process_time() - begun) / (length - 1)
    return {
        **{name: result.measures[name]["psnr"] for name in ROWS},
        "frames": length - 1,
        "frame_ms": spent,
    }, result


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks vis_wrists", description=str(__doc__).splitlines()[0])
    parser.add_argument("--films", type=Path, required=True, metavar="DIR")
    parser.add_argument("--bank", default="lab", help="bank of reference photos (default: the built-in one)")
    parser.add_argument("--remake", action="store_true", help="rebuild the wrists' part of the bank from the films")
    parser.add_argument("--strips", type=Path, metavar="DIR", help="write picture strips of every episode")
    parser.add_argument("--out", type=Path, help="rows as JSON")
    a = parser.parse_args(arguments)
    films(a.films)
    bank = load_bank(a.bank)
    if a.remake:
        known = [e for camera in CAMERAS for e in load_episodes([a.films / "wrists"], camera)]
        bank = replace(bank, moving=make_moving_bench(known))
        save_bank(bank, a.films / "wrists.npz")
    rows = []
    print(
        "| episode | bench | " + " | ".join(f"{name}, dB" for name in ROWS) + " | ms a frame |\n|---|---|" + "---|" * 4
    )
    for episode in moving("wrists_test", a.films):
        for name, bench in (("known", bank.moving), ("unknown", None)):
            figures, result = judge(episode, bench)
            row = {"episode": episode.name, "bench": name, **figures}
            rows.append(row)
            if a.strips is not None and name == "known":
                a.strips.mkdir(parents=True, exist_ok=True)
                clips = {key: result.clips[key] for key in ("simulated", CLOSED, "real")}
                save_picture(metrics.strip(clips, columns=6, zoom=1), a.strips / f"wrists_{len(rows) // 2}.jpg")
            print(
                f"| {episode.name} | {name} | " + " | ".join(f"{row[k]:.1f}" for k in (*ROWS, "frame_ms")) + " |",
                flush=True,
            )
            save(rows, a.out)
    for name in ("known", "unknown"):
        mine = [row for row in rows if row["bench"] == name]
        means = (np.mean([row[k] for row in mine]) for k in (*ROWS, "frame_ms"))
        print(f"| mean of {len(mine)} | {name} | " + " | ".join(f"{value:.1f}" for value in means) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
