"""One filmed episode: played by the expert, drawn by the simulator, path-traced, developed, written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.standin.film.appearance import Look
from embodiedreamer_gym.standin.film.appearance_library import find_look
from embodiedreamer_gym.standin.film.blender import render as blender
from embodiedreamer_gym.standin.film.camera_noise import FINER, Optics, meter, quantise, sense
from embodiedreamer_gym.standin.film.play import Played, Stage
from embodiedreamer_gym.standin.film.scene import Take, make_scene
from embodiedreamer_gym.standin.film.settings import Film
from embodiedreamer_gym.standin.film.write import CAMERA, Real, Simulated, is_filmed, write_episode

AWAY = 50.0  # m down, where the props are while the exposure is metered

Render = Callable[[dict[str, Any]], Iterator[np.ndarray]]


def film_episode(film: Film, number: int, folder: Path, python: str | None = None,
                 tell: Callable[[], None] | None = None, render: Render | None = None) -> int:  # fmt: skip
    """Film one episode into a folder, unless it is there; the number of its pictures, 0 where it was there already.

    python: one that has bpy, by default this one; tell: called after each picture; render: in place of Blender.
    Raises: MissingExtraError without bpy; RecordingError for a file in the way.
    """
    path = film.path(folder, number)
    if is_filmed(path, film.settings(number)):
        return 0
    seed = film.episode_seed(number)
    look = find_look(film.look, seed)
    optics = Optics(CAMERAS[CAMERA], film.size, look.lens)
    stage = Stage(film.task)
    try:
        whole = stage.play(seed)
        steps = film.choose(whole.busy, number)
        simulated = _simulate(stage, seed, steps, optics)
        played = whole.only(steps)
        take = Take(stage.parts, played.bodies, np.concatenate([_empty(stage, whole), played.poses]))
        light = (render or partial(blender, python=python))(make_scene(take, look, optics.wide, film.samples))
        real = _develop(light, optics, np.random.default_rng([seed, 2]), tell)
        write_episode(path, _signals(stage, played, steps), zip(real, simulated, strict=True),
                      _attributes(film, number, stage, played, look))  # fmt: skip
    finally:
        stage.close()
    return len(steps)


def _empty(stage: Stage, played: Played) -> np.ndarray:
    """Poses (1, bodies, 4, 4) of the first state without its props, by which every episode of a look is exposed."""
    poses = played.poses[:1].copy()
    poses[:, len(stage.links) :, 2, 3] -= AWAY
    return poses


def _simulate(stage: Stage, seed: int, steps: np.ndarray, optics: Optics) -> list[Simulated]:
    """What the simulator sees of these steps, with the classes that the lens will show; it plays the episode again."""
    width, height = optics.wide.size
    found: list[Simulated] = []

    def watch(step: int) -> None:
        if step in steps:
            frame = stage.capture(optics.camera, optics.size)
            fine = stage.capture(optics.wide, (FINER * width, FINER * height)).segmentation
            found.append(Simulated(frame, optics.bend_classes(fine)))

    stage.play(seed, int(steps[-1]) + 1, watch)
    return found


def _develop(light: Iterator[np.ndarray], optics: Optics, rng: np.random.Generator,
             tell: Callable[[], None] | None) -> Iterator[Real]:  # fmt: skip
    """Pictures of all but the first, which sets the exposure."""
    exposure = meter(optics.bend(next(light)), optics.lens)
    for one in light:
        pixels = optics.develop(one, exposure)
        yield Real(sense(pixels, rng), quantise(pixels))
        if tell is not None:
            tell()


def _signals(stage: Stage, played: Played, steps: np.ndarray) -> dict[str, np.ndarray]:
    """The numbers of a file."""
    signals = {
        "action": played.action.astype(np.float64),
        "observations/qpos": played.position,
        "timestamps": steps / stage.env.control_hz,
    }
    return signals | {f"objects/{name}": poses for name, poses in played.objects.items()}


def _attributes(film: Film, number: int, stage: Stage, played: Played, look: Look) -> dict[str, Any]:
    """What a file says of itself."""
    env, camera = stage.env, CAMERAS[CAMERA]
    return {
        "film": film.settings(number), "task": film.task, "side": played.side, "seed": film.episode_seed(number),
        "camera": {f.name: getattr(camera, f.name) for f in fields(camera) if f.name != "name"},
        "class_names": list(env.segmentation_classes), "look": look.as_dict(), "renderer": env.renderer.name,
        "control_hz": env.control_hz, "rate": env.control_hz / film.every, "command_hold": env.robot.command_hold,
        "joint_names": list(env.robot.joints), "units": list(env.robot.units),
    }  # fmt: skip
