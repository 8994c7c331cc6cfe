"""Simulated frames become real-looking ones, chunk by chunk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorWrapper

from embodiedreamer_gym.envs.tasks.task import Task
from embodiedreamer_gym.errors import SimulationError, VisionError
from embodiedreamer_gym.vis_aligner import Aligner, Bank, Condition, References, load_aligner, load_bank
from embodiedreamer_gym.vis_aligner.bank import Entry
from embodiedreamer_gym.vis_aligner.editing import ReferenceEditor, edited
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk

SHOWING = ("pixels", "pixels_agent_pos")


class VisAlignerObservationWrapper(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Gives the head camera's pictures a real face; reward and physics stay as they are.

    Put it around an `ActionChunk(env, k, camera="head")`; without one, it puts one of the aligner's chunk there itself, so
    that the action is (k, 14). After each chunk info["frames"] holds the dreamed frames (F, H, W, 3) uint8, F = k unless
    it is filmed less often, and info["filmed"] how many of them are new; the observation shows the last; it is the
    reference of the next chunk, beside the anchor, the first frame
    of the episode. At a reset the reference is painted from photos of a bench: an empty plate, and the objects put in
    where the simulator has them; or, with `reset(options={"reference": i})`, it is photo i itself, to whose joints and
    objects the simulator is set. Only the head camera is dreamed: wrist cameras are left out of the observation.

    aligner: "lean" (the shipped weights), or a path; bank: "lab" (the shipped photos), or a path; chunk: actions of a
    chunk, the aligner's own where None; every: a frame after each n-th action of a chunk, and after its last: dreaming
    takes as much less; editor: changes each episode's bench and objects, with draws of the reset's seed.
    Raises: VisionError where weights, photos and picture size do not fit; SimulationError for observations without
    pictures.
    """

    def __init__(
        self, env: gym.Env, aligner: str = "lean", bank: str = "lab", chunk: int | None = None,
        editor: ReferenceEditor | None = None, every: int = 1,
    ) -> None:  # fmt: skip
        gym.utils.RecordConstructorArgs.__init__(
            self, aligner=aligner, bank=bank, chunk=chunk, editor=editor, every=every
        )
        self.aligner, photos = load_aligner(aligner), load_bank(bank)
        gym.Wrapper.__init__(self, filmed(env, photos, chunk or self.aligner.chunk, every))
        self.bank = photos.of(_props(env.unwrapped.task))  # pyright: ignore[reportAttributeAccessIssue]
        self._picture = picture(self.bank)
        self.observation_space = _with_picture(self.env.observation_space, self._picture)
        self.references: References | None = None
        self.editor, self._draws = editor, np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; options: those of the environment, and reference: number of a photo of the bank."""
        options, entry = _chosen(self.bank, options)
        observation, info = self.env.reset(seed=seed, options=options)
        condition = conditions(info)
        self.references = first(self.bank, condition, entry)
        self._draws = self._draws if seed is None else np.random.default_rng(seed)
        if self.editor is not None:
            names = self.env.unwrapped.segmentation_classes  # pyright: ignore[reportAttributeAccessIssue]
            self.references = edited(self.references, self.editor, int(self._draws.integers(2**31)), names=names)
        frames = np.repeat(self.references.last[None], len(condition), axis=0)
        return self._seen(observation), _told(info, frames)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Play a chunk of actions and dream what the camera would have shown."""
        if self.references is None:
            raise gym.error.ResetNeeded("call reset before the first step.")
        observation, reward, terminated, truncated, info = self.env.step(action)
        (frames,), (self.references,) = _dream(self.aligner, [self.references], [conditions(info)], [info["filmed"]])
        return self._seen(observation), float(reward), terminated, truncated, _told(info, frames)

    def render(self) -> Any:
        """The last dreamed frame (H, W, 3), where the environment renders at all."""
        return None if self.render_mode is None or self.references is None else self.references.last

    def _seen(self, observation: Any) -> Any:
        return observation if self.references is None else _shown(observation, self.references.last)


class VisAlignerVectorWrapper(VectorWrapper):
    """The same for a vector of environments: all their chunks go through the network at once.

    Each environment must be an `ActionChunk` with the head camera, see `filmed`; for instance
    `gym.make_vec(id, 8, wrappers=[lambda env: ActionChunk(env, 8, camera="head")])`.
    info["frames"] is (environments, F, H, W, 3) uint8.

    Raises: VisionError where weights, photos and picture size do not fit; SimulationError for other environments.
    """

    def __init__(self, env: VectorEnv, aligner: str = "lean", bank: str = "lab") -> None:
        super().__init__(env)
        self.aligner: Aligner = load_aligner(aligner)
        photos = load_bank(bank)
        one = picture(photos)
        pixels = _pixels(env.single_observation_space)
        if pixels is None or pixels.shape != one.shape:
            raise VisionError(f"the environments must show pictures {one.shape}, as the bank's photos; make them with "
                              f"image_size={photos.size} and obs_type='pixels_agent_pos'.")  # fmt: skip
        self.bank: Bank = photos.of(_props(env.get_attr("task")[0]))  # pyright: ignore[reportAttributeAccessIssue]
        self.references: list[References | None] = [None] * env.num_envs

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Start an episode in each; options: those of the environment, and reference: number of a photo of the bank."""
        options, entry = _chosen(self.bank, options)
        observation, info = self.env.reset(seed=seed, options=options)  # pyright: ignore[reportArgumentType]
        views = self._views(info)
        starts = [first(self.bank, view, entry) for view in views]
        frames = np.stack([np.repeat(r.last[None], len(v), axis=0) for r, v in zip(starts, views, strict=True)])
        self.references = list(starts)
        return self._seen(observation), _told(info, frames)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Play a chunk of actions in each environment and dream what their cameras would have shown."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        views, filmed = self._views(info), info["filmed"]
        going = [i for i, count in enumerate(filmed) if count > 0]
        frames = np.stack([view.rgb for view in views])
        before = [self._reference(i) for i in going]
        made, after = _dream(self.aligner, before, [views[i] for i in going], [filmed[i] for i in going])
        for i, clip, reference in zip(going, made, after, strict=True):
            frames[i], self.references[i] = clip, reference
        for i in set(range(len(views))) - set(going):  # begun anew by the vector
            self.references[i] = first(self.bank, views[i], None)
            frames[i] = self._reference(i).last
        return self._seen(observation), reward, terminated, truncated, _told(info, frames)

    def _reference(self, i: int) -> References:
        found = self.references[i]
        if found is None:
            raise gym.error.ResetNeeded("call reset before the first step.")
        return found

    def _views(self, info: Mapping[str, Any]) -> list[Condition]:
        if "clip" not in info:
            raise SimulationError('each environment must be wrapped in ActionChunk(env, k, camera="head").')
        clip = {key: seen for key, seen in info["clip"].items() if not key.startswith("_")}  # masks of the vector
        return [Condition(**{key: seen[i] for key, seen in clip.items()}) for i in range(self.num_envs)]

    def _seen(self, observation: Any) -> Any:
        return _shown(observation, np.stack([self._reference(i).last for i in range(len(self.references))]))


# ---- what both share -------------------------------------------------------------------------------------------


def filmed(env: gym.Env, bank: Bank, chunk: int, every: int = 1) -> gym.Env:
    """The environment, in an `ActionChunk` that films with the head camera at the bank's size.

    Raises: SimulationError for observations without pictures, VisionError for an ActionChunk that films something else.
    """
    kind = getattr(env.unwrapped, "obs_type", None)
    if kind not in SHOWING:
        raise SimulationError(
            f"VisAlignerObservationWrapper dreams pictures, and obs_type {kind!r} has none; "
            f"make the environment with obs_type={SHOWING[1]!r} or {SHOWING[0]!r}."
        )
    inner = env
    while isinstance(inner, gym.Wrapper) and not isinstance(inner, ActionChunk):
        inner = inner.env
    if not isinstance(inner, ActionChunk):
        return ActionChunk(env, chunk, camera="head", size=bank.size, every=every)
    if inner.camera != "head" or (inner.size or getattr(env.unwrapped, "image_size", None)) != bank.size:
        width, height = bank.size
        raise VisionError(
            f"the bank's photos are {width} x {height} of the head camera; "
            f'wrap with ActionChunk(env, k, camera="head", size=({width}, {height})), or leave ActionChunk out.'
        )
    return env


def picture(bank: Bank) -> spaces.Box:
    """The space of the bank's pictures."""
    width, height = bank.size
    return spaces.Box(0, 255, (height, width, 3), np.uint8)


def conditions(info: Mapping[str, Any]) -> Condition:
    """The simulator's view of a chunk."""
    return Condition(**info["clip"])


def first(bank: Bank, condition: Condition, entry: Entry | None) -> References:
    """The references of an episode's beginning: a photo, or one painted."""
    frame = entry.frame if entry is not None else bank.compose(condition)
    return References.start(frame, condition.part(0, 1), bank.bench)


def _dream(aligner: Aligner, references: Sequence[References], views: Sequence[Condition], filmed: Sequence[int]
           ) -> tuple[list[np.ndarray], list[References]]:  # fmt: skip
    """Frames (F, H, W, 3) of each view of F frames, piece by piece as the aligner was trained, and the references after.

    filmed: of each, how many are new; later frames repeat the last one.
    """
    known = list(references)
    frames = [np.repeat(reference.last[None], len(view), axis=0) for reference, view in zip(known, views, strict=True)]
    for start in range(0, int(max(filmed, default=0)), aligner.chunk):
        going = [i for i, count in enumerate(filmed) if count > start]
        parts = [views[i].part(start, start + aligner.chunk) for i in going]
        made = aligner.render([known[i] for i in going], parts)
        for i, part, clip in zip(going, parts, made, strict=True):
            count = min(int(filmed[i]) - start, len(part))
            known[i] = known[i].after(clip[:count], part.part(0, count))
            frames[i][start : start + count] = clip[:count]
            frames[i][start + count :] = clip[count - 1]
    return frames, known


def _chosen(bank: Bank, options: Mapping[str, Any] | None) -> tuple[dict[str, Any] | None, Entry | None]:
    """Options for the environment, and the photo that they ask for."""
    options = dict(options or {})
    if "reference" not in options:
        return options or None, None
    entry = bank.entry(options.pop("reference"))
    return options | entry.options(), entry


def _props(task: Task) -> list[str]:
    """Names of the objects in a task's scene."""
    return [prop.name for prop in task.props]


def _pixels(space: spaces.Space | None) -> spaces.Space | None:
    return space.spaces.get("pixels") if isinstance(space, spaces.Dict) else space


def _with_picture(space: spaces.Space, one: spaces.Box) -> spaces.Space:
    return spaces.Dict({**space.spaces, "pixels": one}) if isinstance(space, spaces.Dict) else one


def _shown(observation: Any, frames: np.ndarray | Sequence[np.ndarray]) -> Any:
    return {**observation, "pixels": frames} if isinstance(observation, Mapping) else frames


def _told(info: Mapping[str, Any], frames: np.ndarray) -> dict[str, Any]:
    return {key: value for key, value in info.items() if key not in ("clip", "_clip")} | {"frames": frames}
