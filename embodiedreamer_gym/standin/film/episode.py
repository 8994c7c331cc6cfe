"""Film one episode: play the expert, render it with the simulator and with Blender, write the file."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from embodiedreamer_gym.envs.cameras import CAMERAS
from embodiedreamer_gym.standin.film.appearance import Appearance
from embodiedreamer_gym.standin.film.appearance_library import find_appearance
from embodiedreamer_gym.standin.film.blender import render as render_with_blender
from embodiedreamer_gym.standin.film.camera_noise import (
    FINER,
    NoisyCamera,
    add_sensor_noise,
    auto_exposure,
    to_uint8,
)
from embodiedreamer_gym.standin.film.play import EpisodePlayer, ExpertEpisode
from embodiedreamer_gym.standin.film.scene import Animation, make_scene
from embodiedreamer_gym.standin.film.settings import FilmSettings
from embodiedreamer_gym.standin.film.write import CAMERA, CameraFrame, SimulatorFrame, is_filmed, write_episode

AWAY = 50.0  # m by which props are lowered out of view while the exposure is set

Render = Callable[[dict[str, Any]], Iterator[np.ndarray]]


def film_episode(film: FilmSettings, number: int, folder: Path, blender: str | None = None,
                 report: Callable[[], None] | None = None, render: Render | None = None) -> int:  # fmt: skip
    """Film one episode into a folder unless its file exists; returns the number of pictures rendered, else 0.

    blender: path of a Python interpreter that has bpy, see `find_blender`.
    report: called after each picture.
    render: used instead of Blender.
    Raises: MissingExtraError without bpy; RecordingError where the path has other content.
    """
    path = film.path(folder, number)
    if is_filmed(path, film.as_dict(number)):
        return 0
    seed = film.episode_seed(number)
    appearance = find_appearance(film.appearance, seed)
    cameras = {name: NoisyCamera(CAMERAS[name], film.size, appearance.camera_noise) for name in film.cameras}
    player = EpisodePlayer(film.task)
    try:
        whole = player.play(seed)
        steps = film.choose_steps(whole.active_steps, number)
        simulated = _simulate(player, seed, steps, cameras)
        episode = whole.select(steps)
        pictures = {}
        for name, camera in cameras.items():
            metered = whole.poses[0] if camera.camera.link is None else episode.poses[len(steps) // 2]
            poses = np.concatenate([_without_props(player, metered)[None], episode.poses])
            animation = Animation(player.parts, episode.bodies, poses)
            scene = make_scene(animation, appearance, camera.wide, film.samples)
            light = (render or partial(render_with_blender, blender=blender))(scene)
            own = [] if name == CAMERA else [zlib.crc32(name.encode())]
            developed = _develop(light, camera, np.random.default_rng([seed, 2, *own]), report)
            pictures[name] = zip(developed, simulated[name], strict=True)
        write_episode(path, _signals(player, episode, steps), pictures,
                      _attributes(film, number, player, episode, appearance))  # fmt: skip
    finally:
        player.close()
    return len(steps) * len(cameras)


def _without_props(player: EpisodePlayer, poses: np.ndarray) -> np.ndarray:
    """Poses (bodies, 4, 4) of a state with the props out of view; this frame sets the exposure."""
    poses = poses.copy()
    poses[len(player.links) :, 2, 3] -= AWAY
    return poses


def _simulate(
    player: EpisodePlayer, seed: int, steps: np.ndarray, cameras: Mapping[str, NoisyCamera]
) -> dict[str, list[SimulatorFrame]]:
    """The simulator's renderings of these steps, and the classes after distortion; plays the episode again."""
    frames: dict[str, list[SimulatorFrame]] = {name: [] for name in cameras}

    def capture(step: int) -> None:
        if step in steps:
            for name, camera in cameras.items():
                width, height = camera.wide.size
                frame = player.capture(camera.camera, camera.size)
                fine = player.capture(camera.wide, (FINER * width, FINER * height)).segmentation
                frames[name].append(SimulatorFrame(frame, camera.distort_classes(fine)))

    player.play(seed, int(steps[-1]) + 1, capture)
    return frames


def _develop(light: Iterator[np.ndarray], camera: NoisyCamera, rng: np.random.Generator,
             report: Callable[[], None] | None) -> Iterator[CameraFrame]:  # fmt: skip
    """Pictures of all renderings but the first, which sets the exposure."""
    exposure = auto_exposure(camera.distort(next(light)), camera.noise)
    for rendering in light:
        pixels = camera.develop(rendering, exposure)
        yield CameraFrame(add_sensor_noise(pixels, rng), to_uint8(pixels))
        if report is not None:
            report()


def _signals(player: EpisodePlayer, episode: ExpertEpisode, steps: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays of a file by dataset."""
    signals = {
        "action": episode.action.astype(np.float64),
        "observations/qpos": episode.position,
        "timestamps": steps / player.env.control_hz,
    }
    return signals | {f"objects/{name}": poses for name, poses in episode.objects.items()}


def _attributes(film: FilmSettings, number: int, player: EpisodePlayer, episode: ExpertEpisode,
                appearance: Appearance) -> dict[str, Any]:  # fmt: skip
    """Attributes of a file."""
    env = player.env
    described = {name: {f.name: getattr(CAMERAS[name], f.name) for f in fields(CAMERAS[name]) if f.name != "name"}
                 for name in film.cameras}  # fmt: skip
    first, *more = film.cameras
    return {
        "film": film.as_dict(number), "task": film.task, "side": episode.side, "seed": film.episode_seed(number),
        "camera": described[first], **({"cameras": described} if more else {}),
        "class_names": list(env.segmentation_classes), "look": appearance.as_dict(), "renderer": env.engine.renderer_name,
        "control_hz": env.control_hz, "rate": env.control_hz / film.every, "command_hold": env.robot.command_hold,
        "joint_names": list(env.robot.joints), "units": list(env.robot.units),
    }  # fmt: skip
