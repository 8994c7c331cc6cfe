"""Wrappers that replace simulated frames by generated ones, chunk by chunk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorWrapper

from embodiedreamer_gym.envs.cameras import CAMERAS
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
        self.cameras = tuple(cameras)
        if editor is not None and len(self.cameras) > 1:
            raise SimulationError("an editor changes the pictures of one camera; leave it out, or the other cameras.")
        gym.Wrapper.__init__(self, filmed(env, photos, self.aligner.chunk, chunk, every, self.cameras))
        self.bank = photos.of(_props(getattr(env.unwrapped, "task", None)))
        shown = pixel_space(self.cameras, self.bank.size)
        self.observation_space = _with_picture(self.env.observation_space, shown)
        moving = [name for name in self.cameras if _moves(env, name)]
        aligners = dict.fromkeys(self.cameras, self.aligner)
        aligners |= dict.fromkeys(moving, load_aligner(moving_aligner, device=device)) if moving else {}
        self._frames = {name: GeneratedFrames(one, self.bank, 1, grain) for name, one in aligners.items()}
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
        frames = {}
        for name, generated in self._frames.items():
            generated.seed([seed])
            (frames[name],) = generated.begin([self._view(info, name)], entry, self._edit)
        return self._shown(observation, info, frames)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Play a chunk of actions and generate the frames of the cameras."""
        self._frames[self.cameras[0]].last(0)  # raises before the environment moves
        observation, reward, terminated, truncated, info = self.env.step(action)
        frames = {}
        for name, generated in self._frames.items():
            (frames[name],) = generated.render([self._view(info, name)], [info["filmed"]])
        observation, info = self._shown(observation, info, frames)
        return observation, float(reward), terminated, truncated, info

    def render(self) -> Any:
        """The last generated frame (H, W, 3) of the first camera; None without a render mode."""
        return None if self.render_mode is None else self._frames[self.cameras[0]].shown[0]

    def _view(self, info: Mapping[str, Any], camera: str) -> Condition:
        """The simulator's view of a chunk by a camera."""
        return conditions(info) if len(self.cameras) == 1 else Condition(**info["clips"][camera])

    def _shown(
        self, observation: Any, info: Mapping[str, Any], frames: dict[str, np.ndarray]
    ) -> tuple[Any, dict[str, Any]]:
        """Observation and info with the generated frames."""
        if len(frames) == 1:
            (clip,) = frames.values()
            return _shown(observation, clip[-1]), _with_frames(info, clip)
        return _shown(observation, {name: clip[-1] for name, clip in frames.items()}), _with_frames(info, frames)

    def _edit(self, references: References) -> References:
        if self.editor is None:
            return references
        names = self.env.unwrapped.segmentation_classes  # pyright: ignore[reportAttributeAccessIssue]
        return edited(references, self.editor, int(self._rng.integers(2**31)), names=names)


class VisAlignerVectorWrapper(VectorWrapper):
    """The same for a vector of environments, whose chunks go through the network together.

    Each environment must be an `ActionChunk`, which is set to film with the head camera; for instance
    `gym.make_vec(id, 8, wrappers=[lambda env: ActionChunk(env, 8)])`.
    info["frames"] is (environments, F, H, W, 3) uint8.

    device: as in `VisAlignerObservationWrapper`.
    Raises: VisionError if weights, photos and picture size do not fit, or the device is not available; SimulationError
    for other environments.
    """

    def __init__(
        self, env: VectorEnv, aligner: str = "lean", bank: str = "lab", grain: bool = False, device: str = "cpu"
    ) -> None:
        super().__init__(env)
        self.aligner: Aligner = load_aligner(aligner, device=device)
        photos = load_bank(bank)
        one = pixel_space(("head",), photos.size)
        pixels = _pixels(env.single_observation_space)
        if pixels is None or pixels.shape != one.shape:
            raise VisionError(f"the environments must show pictures {one.shape}, as the bank's photos; make them with "
                              f"image_size={photos.size} and obs_type='pixels_agent_pos'.")  # fmt: skip
        try:
            env.call("film", "head", photos.size)  # pyright: ignore[reportAttributeAccessIssue]
        except AttributeError as error:
            raise SimulationError("each environment must be wrapped in ActionChunk(env, k).") from error
        self.bank: Bank = photos.of(_props(env.get_attr("task")[0]))  # pyright: ignore[reportAttributeAccessIssue]
        self._frames = GeneratedFrames(self.aligner, self.bank, env.num_envs, grain)

    @property
    def references(self) -> list[References | None]:
        """References of each environment's next chunk; None before the first reset."""
        return self._frames.references

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Start an episode in each; options: those of the environment, and `reference`, number of a bank photo."""
        options, entry = _chosen(self.bank, options)
        observation, info = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        whole = isinstance(seed, int | np.integer)
        self._frames.seed([seed + i for i in range(self.num_envs)] if whole else seed or [None] * self.num_envs)  # pyright: ignore
        frames = self._frames.begin(self._views(info), entry)
        return _shown(observation, frames[:, -1]), _with_frames(info, frames)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Play a chunk of actions in each environment and generate the frames of their cameras."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        frames = self._frames.render(self._views(info), info["filmed"])
        return _shown(observation, frames[:, -1]), reward, terminated, truncated, _with_frames(info, frames)

    def _views(self, info: Mapping[str, Any]) -> list[Condition]:
        clip = {key: values for key, values in info["clip"].items() if not key.startswith("_")}  # masks of the vector
        return [Condition(**{key: values[i] for key, values in clip.items()}) for i in range(self.num_envs)]


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


def conditions(info: Mapping[str, Any]) -> Condition:
    """Return the simulator's view of a chunk."""
    return Condition(**info["clip"])


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


def _moves(env: gym.Env, camera: str) -> bool:
    """Whether a camera moves with a link of the environment's robot."""
    known = {**CAMERAS, **getattr(env.unwrapped, "cameras", {})}
    return camera in known and known[camera].link is not None


def _shown(observation: Any, frames: Any) -> Any:
    return {**observation, "pixels": frames} if isinstance(observation, Mapping) else frames


def _with_frames(info: Mapping[str, Any], frames: Any) -> dict[str, Any]:
    return {key: value for key, value in info.items() if key not in ("clip", "_clip", "clips")} | {"frames": frames}
