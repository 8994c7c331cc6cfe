"""Wrappers that replace simulated frames by generated ones, chunk by chunk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from embodiedreamer_gym.envs.observations import pixel_space
from embodiedreamer_gym.envs.tasks.task import Task
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.vis_aligner import Aligner, Bank, Condition, References, load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.bank import Entry
from embodiedreamer_gym.vis_aligner.editing import ReferenceEditor, edited
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk, chunks_inside
from embodiedreamer_gym.wrappers.generated_frames import GeneratedFrames

SHOWING = ("pixels", "pixels_agent_pos")


class VisAlignerObservationWrapper(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Replaces the cameras' pictures by those of a video model; reward and physics do not change.

    Your own environment needs the attributes `obs_type` ("pixels" or "pixels_agent_pos") and `image_size` and a method
    `capture(camera, size)` that returns a `Frame` (`engines.frame`), as `RobotView.at` does.
    The wrapped environment may be an `ActionChunk(env, k)`; any other is wrapped in an `ActionChunk` of the aligner's
    chunk length, so that the action is (k, 14). The observation shows the last frame of a chunk. The next chunk is
    generated with two references: this frame, and the anchor, which is the first frame of the episode. At a reset, the
    reference is composed from photos of a bench: an empty plate, with the objects where the simulator has them. With
    `reset(options={"reference": i})`, it is photo i itself, and the simulator is set to its joints and objects.

    info["frames"]: generated frames (F, H, W, 3) uint8 after each chunk, F = k unless `every` is larger; with several
    cameras, by camera name, as in the observation.
    info["filmed"]: how many of these frames are new.

    aligner: "lean" (the shipped weights), or a path.
    bank: "lab" (the shipped photos), or a path.
    chunk: actions per chunk; None for the length of an existing ActionChunk, else for the aligner's own.
    editor: changes each episode's bench and objects, with random draws from the reset's seed.
    every: n, for a frame after each n-th action of a chunk and after its last; generation time falls accordingly.
    grain: whether to add the noise of the bench's sensor, the same for the same seed of the reset; the next frames are
    generated from frames without it.
    device: of the network: cpu, cuda, ..., or auto for an accelerator if there is one.
    cameras: whose pictures are generated; the others are left out of the observation. Cameras that move with the robot,
    such as those on its wrists, need a bank made with `vis bank --moving`.
    moving_aligner: the aligner for cameras that move; "assembled" needs no network.
    Raises: VisionError if weights, photos and picture size do not fit, or the device is not available; SimulationError
    for observations without pictures, or an editor with more than one camera.
    """

    def __init__(
        self, env: gym.Env, aligner: str = "lean", bank: str = "lab", chunk: int | None = None,
        editor: ReferenceEditor | None = None, every: int = 1, grain: bool = False,
        device: str = "cpu", cameras: Sequence[str] = ("head",), moving_aligner: str = "assembled",
    ) -> None:  # fmt: skip
        gym.utils.RecordConstructorArgs.__init__(
            self, aligner=aligner, bank=bank, chunk=chunk, editor=editor, every=every, grain=grain, device=device,
            cameras=cameras, moving_aligner=moving_aligner,
        )  # fmt: skip
        self.aligner, photos = load_aligner(aligner, device=device), load_bank(bank)
        self.cameras = _names(cameras)
        if editor is not None and len(self.cameras) > 1:
            raise SimulationError("an editor changes the pictures of one camera; leave it out, or the other cameras.")
        gym.Wrapper.__init__(self, filmed(env, photos, self.aligner.chunk, chunk, every, self.cameras))
        self.bank = photos.of(_props(getattr(env.unwrapped, "task", None)))
        self.observation_space = _with_picture(self.env.observation_space, pixel_space(self.cameras, self.bank.size))
        moving = load_aligner(moving_aligner, device=device)
        self._frames = {name: GeneratedFrames(self.aligner, moving, self.bank, 1, grain) for name in self.cameras}
        self.editor, self._rng = editor, np.random.default_rng()

    @property
    def references(self) -> References | None:
        """References of the first camera's next chunk; None before the first reset."""
        return self._frames[self.cameras[0]].references[0]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; options: those of the environment, and `reference`, the number of a photo of the bank."""
        options, entry = _chosen(self.bank, options)
        observation, info = self.env.reset(seed=seed, options=options)
        self._rng = self._rng if seed is None else np.random.default_rng(seed)
        views, frames = conditions(info, self.cameras), {}
        for name, generated in self._frames.items():
            generated.seed([seed])
            (frames[name],) = generated.begin([views[name]], entry, self._edit)
        return _with_frames(observation, info, frames)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Play a chunk of actions and generate the frames of the cameras."""
        self._frames[self.cameras[0]].last(0)  # raises before the environment moves
        observation, reward, terminated, truncated, info = self.env.step(action)
        views, filmed = conditions(info, self.cameras), [info["filmed"]]
        frames = {name: generated.render([views[name]], filmed)[0] for name, generated in self._frames.items()}
        observation, info = _with_frames(observation, info, frames)
        return observation, float(reward), terminated, truncated, info

    def render(self) -> Any:
        """The last generated frame (H, W, 3) of the first camera; None without a render mode."""
        return None if self.render_mode is None else self._frames[self.cameras[0]].shown[0]

    def _edit(self, references: References) -> References:
        if self.editor is None:
            return references
        names = self.env.unwrapped.segmentation_classes  # pyright: ignore[reportAttributeAccessIssue]
        return edited(references, self.editor, int(self._rng.integers(2**31)), names=names)


class VisAlignerVectorWrapper(VectorWrapper):
    """The same for a vector of environments, whose chunks go through the network together.

    Each environment must be an `ActionChunk`, which is set to film with the cameras; for instance
    `gym.make_vec(id, 8, wrappers=[lambda env: ActionChunk(env, 8)])`.
    info["frames"] is (environments, F, H, W, 3) uint8; for several cameras, one such array per camera name.

    device, cameras, moving_aligner: as in `VisAlignerObservationWrapper`.
    Raises: VisionError if weights, photos and picture size do not fit, or the device is not available; SimulationError
    for other environments.
    """

    def __init__(
        self, env: VectorEnv, aligner: str = "lean", bank: str = "lab", grain: bool = False, device: str = "cpu",
        cameras: Sequence[str] = ("head",), moving_aligner: str = "assembled",
    ) -> None:  # fmt: skip
        super().__init__(env)
        self.aligner: Aligner = load_aligner(aligner, device=device)
        self.cameras, photos = _names(cameras), load_bank(bank)
        shown = pixel_space(self.cameras, photos.size)
        pixels = _pixels(env.single_observation_space)
        if pixels is None or (
            isinstance(pixels, spaces.Box) and len(self.cameras) == 1 and pixels.shape != shown.shape
        ):
            raise VisionError(
                f"the environments must show pictures {(*photos.size[::-1], 3)}, as the bank's photos; make them with "
                f"image_size={photos.size} and obs_type='pixels_agent_pos'."
            )
        try:
            env.call("film", self.cameras, photos.size)  # pyright: ignore[reportAttributeAccessIssue]
        except AttributeError as error:
            raise SimulationError("each environment must be wrapped in ActionChunk(env, k).") from error
        self.single_observation_space = _with_picture(env.single_observation_space, shown)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.bank: Bank = photos.of(_props(env.get_attr("task")[0]))  # pyright: ignore[reportAttributeAccessIssue]
        moving, count = load_aligner(moving_aligner, device=device), env.num_envs
        self._frames = {name: GeneratedFrames(self.aligner, moving, self.bank, count, grain) for name in self.cameras}

    @property
    def references(self) -> list[References | None]:
        """References of the first camera in each environment for the next chunk; None before the first reset."""
        return self._frames[self.cameras[0]].references

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Start an episode in each environment; options: as in `VisAlignerObservationWrapper.reset`."""
        options, entry = _chosen(self.bank, options)
        observation, info = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        whole = isinstance(seed, int | np.integer)
        seeds = [seed + i for i in range(self.num_envs)] if whole else seed or [None] * self.num_envs  # pyright: ignore
        frames = {}
        for name, generated in self._frames.items():
            generated.seed(seeds)  # pyright: ignore[reportArgumentType]
            frames[name] = generated.begin(self._views(info, name), entry)
        return _with_frames(observation, info, frames)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Play a chunk of actions in each environment and generate the frames of their cameras."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        filmed = info["filmed"]
        frames = {name: one.render(self._views(info, name), filmed) for name, one in self._frames.items()}
        observation, info = _with_frames(observation, info, frames)
        return observation, reward, terminated, truncated, info

    def _views(self, info: Mapping[str, Any], camera: str) -> list[Condition]:
        """The simulator's view of a chunk in each environment."""
        clip = info["clip"] if len(self.cameras) == 1 else info["clips"][camera]
        arrays = {key: values for key, values in clip.items() if not key.startswith("_")}  # no masks of the vector
        return [Condition(**{key: values[i] for key, values in arrays.items()}) for i in range(self.num_envs)]


def filmed(
    env: gym.Env, bank: Bank, own: int, chunk: int | None = None, every: int = 1, cameras: Sequence[str] = ("head",)
) -> gym.Env:
    """The environment, in an `ActionChunk` that films with these cameras at the bank's size.

    An existing ActionChunk is set to film; otherwise one of `chunk` actions is added, `own` if that is None.
    Raises: SimulationError for observations without pictures, or an ActionChunk of another length or one that films
    something else; VisionError for pictures of another size than the bank's.
    """
    kind = getattr(env.unwrapped, "obs_type", None)
    if kind not in SHOWING:
        raise SimulationError(
            f"VisAlignerObservationWrapper replaces pictures, and obs_type {kind!r} has none; "
            f"make the environment with obs_type={SHOWING[1]!r} or {SHOWING[0]!r}."
        )
    check_size(getattr(env.unwrapped, "image_size", bank.size), bank)
    inner = chunks_inside(env)
    if inner is None:
        return ActionChunk(env, chunk or own, camera=cameras, size=bank.size, every=every)
    if chunk not in (None, inner.k):
        raise SimulationError(
            f"chunk is {chunk}, and ActionChunk takes {inner.k} actions at once; leave one of the two out."
        )
    inner.film(cameras, bank.size, None if every == 1 else every)
    return env


def check_size(size: tuple[int, int], bank: Bank) -> None:
    """Check that a size (width, height) is that of the bank's photos.

    Raises: VisionError if it is not.
    """
    if tuple(size) != bank.size:
        asked, known = (f"{width} x {height}" for width, height in (size, bank.size))
        raise VisionError(
            f"the environment's pictures are {asked}, and the bank's photos {known}; make the environment with "
            f"image_size={bank.size}, or give a bank of {asked}, made by `embodiedreamer standin bank --size {size[0]}x{size[1]} "
            f"--out FILE.npz` (simulated bench, with Blender) or by `embodiedreamer vis bank` of your own episodes of that size."
        )


def conditions(info: Mapping[str, Any], cameras: Sequence[str] = ("head",)) -> dict[str, Condition]:
    """The simulator's view of a chunk by each camera, from the info of an `ActionChunk` that films with these cameras."""
    clips = {cameras[0]: info["clip"]} if len(cameras) == 1 else info["clips"]
    return {name: Condition(**clips[name]) for name in cameras}


def _chosen(bank: Bank, options: Mapping[str, Any] | None) -> tuple[dict[str, Any] | None, Entry | None]:
    """Return the options for the environment, and the photo that the options name."""
    options = dict(options or {})
    if "reference" not in options:
        return options or None, None
    entry = bank.entry(options.pop("reference"))
    return options | entry.options(), entry


def _props(task: Task | None) -> list[str]:
    """Names of the objects in a task's scene; none where there is no task."""
    return [] if task is None else [prop.name for prop in task.props]


def _pixels(space: spaces.Space | None) -> spaces.Space | None:
    return space.spaces.get("pixels") if isinstance(space, spaces.Dict) else space


def _with_picture(space: spaces.Space, one: spaces.Space) -> spaces.Space:
    return spaces.Dict({**space.spaces, "pixels": one}) if isinstance(space, spaces.Dict) else one


def _names(cameras: Sequence[str]) -> tuple[str, ...]:
    """Names of cameras.

    Raises: SimulationError for none, or one twice.
    """
    names = (cameras,) if isinstance(cameras, str) else tuple(cameras)
    if not names or len(set(names)) < len(names):
        raise SimulationError(f"cameras must be one or more different names, such as ('head',), not {names!r}.")
    return names


def _with_frames(
    observation: Any, info: Mapping[str, Any], frames: Mapping[str, np.ndarray]
) -> tuple[Any, dict[str, Any]]:
    """Observation and info with generated frames (..., F, H, W, 3) of each camera."""
    every = dict(frames) if len(frames) > 1 else next(iter(frames.values()))
    last = {name: clip[..., -1, :, :, :] for name, clip in frames.items()}
    pixels = last if len(frames) > 1 else next(iter(last.values()))
    kept = {key: value for key, value in info.items() if key not in ("clip", "_clip", "clips", "_clips")}
    return {**observation, "pixels": pixels} if isinstance(observation, Mapping) else pixels, kept | {"frames": every}
