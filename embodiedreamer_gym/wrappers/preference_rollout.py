"""Rollouts of a policy, several tries from each start, recorded with observations, actions and outcomes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from embodiedreamer_gym.errors import SimulationError
from embodiedreamer_gym.io.progress import ProgressCallback, progress_or_silence
from embodiedreamer_gym.policies.preferences.files import save_trajectories
from embodiedreamer_gym.policies.preferences.likelihood import spread_of
from embodiedreamer_gym.policies.preferences.trajectory import OUTCOMES, Trajectory, flat
from embodiedreamer_gym.policies.protocol import predict
from embodiedreamer_gym.wrappers.action_chunk import ActionChunk

NOISE_PER = ("chunk", "step")
MOST_CHUNKS = 10_000  # after this many, an environment is assumed to have no time limit
Policy = Callable[[Mapping[str, Any]], Any]


class _Rollouts:
    """Tries, noise and the loop over episodes, for both wrappers."""

    tries: int
    noise: float
    per: str
    chunks: int | None
    camera: str

    def _set(self, tries: int, noise: float, per: str, chunks: int | None, camera: str) -> None:
        if tries < 1 or (chunks is not None and chunks < 1):
            raise SimulationError(f"rollouts need at least 1 try and 1 chunk, not {tries} and {chunks}.")
        if not 0 <= noise < np.inf:
            raise SimulationError(f"noise is {noise}, but must be 0 or more, in the policy's normalised units.")
        if per not in NOISE_PER:
            raise SimulationError(f"noise per '{per}' is not one of {', '.join(NOISE_PER)}.")
        self.tries, self.noise, self.per, self.chunks, self.camera = tries, float(noise), per, chunks, camera

    def _batched(self) -> Any:
        raise NotImplementedError

    def rollouts(
        self,
        policy: Policy,
        seeds: Sequence[int],
        spread: np.ndarray | None = None,
        progress: ProgressCallback | None = None,
    ) -> Iterator[Trajectory]:
        """Trajectories in order: all tries from the first seed's start, then from the second's, and so on.

        policy: see embodiedreamer_gym.policies; spread (m,): size of a normalised unit of each action in the
        environment's units, by default that of `policy.network`. The noise depends on seed and try alone, not on the
        number of environments.
        Raises: PolicyError for a policy whose chunks do not fit; SimulationError for an environment with no outcome in
        its info.
        """
        jobs = [(int(seed), attempt) for seed in seeds for attempt in range(self.tries)]
        spread = _spread(policy, self._batched().single_action_space.shape[1]) if spread is None else np.asarray(spread)
        done, shown = 0, progress_or_silence(progress)
        for first in range(0, len(jobs), self._batched().num_envs):
            for one in self._play(policy, jobs[first : first + self._batched().num_envs], spread):
                done += 1
                shown("rollouts", done, len(jobs), **{name: f"{value:.3g}" for name, value in one.outcome.items()})
                yield one

    def record(
        self, policy: Policy, seeds: Sequence[int], folder: str | Path, spread: np.ndarray | None = None,
        progress: ProgressCallback | None = None,
    ) -> list[Path]:  # fmt: skip
        """Write the tries of each start to a file in a folder, and return the files; existing ones are kept."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files = {int(seed): folder / f"start-{int(seed):08d}.hdf5" for seed in seeds}
        tries: list[Trajectory] = []
        for one in self.rollouts(policy, [s for s, path in files.items() if not path.is_file()], spread, progress):
            tries.append(one)
            if len(tries) == self.tries:
                save_trajectories(tries, files[one.seed])
                tries = []
        return list(files.values())

    def _play(self, policy: Policy, jobs: Sequence[tuple[int, int]], spread: np.ndarray) -> list[Trajectory]:
        """Play one episode in each environment; those without a job repeat the last job and are dropped."""
        envs = self._batched()
        padded = [*jobs, *jobs[-1:] * (envs.num_envs - len(jobs))]
        if callable(getattr(policy, "reset", None)):  # a policy with a memory
            policy.reset()  # pyright: ignore[reportFunctionMemberAccess]
        rngs = [np.random.default_rng([abs(seed), attempt]) for seed, attempt in padded]
        observation, _ = envs.reset(seed=[seed for seed, _ in padded])
        log = _Log(len(jobs))
        ends: list[dict[str, float] | None] = [None] * len(jobs)
        limit = self.chunks or MOST_CHUNKS
        for number in range(limit):
            batch = policy_batch(observation, self.camera)
            predicted = predict(policy, batch, (envs.num_envs, *envs.single_action_space.shape))
            actions = predicted + self.noise * spread * np.stack([self._draw(rng, predicted.shape[1:]) for rng in rngs])
            actions = actions.astype(np.float32)  # recorded unclipped: without noise they equal the predicted ones
            played = np.clip(actions, envs.single_action_space.low, envs.single_action_space.high)
            observation, _, terminated, truncated, info = envs.step(played)
            over = (np.asarray(terminated) | np.asarray(truncated))[: len(jobs)]
            log.add(batch, actions, predicted, info, [end is None for end in ends])
            for i in range(len(jobs)):
                if ends[i] is None and (over[i] or number + 1 == self.chunks):
                    ends[i] = outcome(info, i)
            if None not in ends:
                return log.trajectories(jobs, ends)
            if over.any() and getattr(envs, "metadata", {}).get("autoreset_mode") == AutoresetMode.DISABLED:
                raise SimulationError(
                    "episodes differ in length, and the vector has autoreset_mode DISABLED; use another mode."
                )
        raise SimulationError(
            f"an episode is not over after {limit} chunks; give the environment a time limit, or chunks."
        )

    def _draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        """Standard normal exploration noise (k, m): one offset for the whole chunk, or a new one at each step."""
        drawn = rng.standard_normal((1 if self.per == NOISE_PER[0] else shape[0], shape[1]))
        return np.broadcast_to(drawn, shape)


class PreferenceRolloutWrapper(gym.Wrapper, _Rollouts, gym.utils.RecordConstructorArgs):
    """Adds `rollouts(policy, seeds)` to an environment: K tries from each start, with exploration noise.

    The environment takes chunks (k, m): an `ActionChunk`, a `VisAlignerObservationWrapper` (generated frames), or any
    other with chunk=k, which is then wrapped in an `ActionChunk`. reset and step pass through.

    tries: K; noise: standard deviation of the exploration, in the policy's normalised units; per: `chunk`, one offset
    for all actions of a chunk, or `step`; chunk: k, for an environment without chunks; chunks: number of chunks in a
    trajectory, by default until the episode is over; camera: name that a single picture gets.
    Raises: SimulationError for numbers out of range, or an environment without chunks.
    Source: EmbodieDreamer, section 4.3; several tries from one start as in GRAPE (Zhang et al. 2024).
    """

    def __init__(
        self, env: gym.Env, tries: int = 4, noise: float = 0.1, per: str = "chunk", chunk: int | None = None,
        chunks: int | None = None, camera: str = "head",
    ) -> None:  # fmt: skip
        gym.utils.RecordConstructorArgs.__init__(
            self, tries=tries, noise=noise, per=per, chunk=chunk, chunks=chunks, camera=camera
        )
        gym.Wrapper.__init__(self, env if chunk is None else ActionChunk(env, chunk))
        _check_chunked(self.env.action_space)
        self._set(tries, noise, per, chunks, camera)

    def _batched(self) -> Any:
        return _Single(self.env)


class PreferenceRolloutVectorWrapper(VectorWrapper, _Rollouts):
    """The same for a vector of environments that take chunks (k, m): it plays one episode in each at the same time.

    Raises: SimulationError for numbers out of range, or environments without chunks.
    """

    def __init__(
        self, env: VectorEnv, tries: int = 4, noise: float = 0.1, per: str = "chunk", chunks: int | None = None,
        camera: str = "head",
    ) -> None:  # fmt: skip
        VectorWrapper.__init__(self, env)
        _check_chunked(env.single_action_space)
        self._set(tries, noise, per, chunks, camera)

    def _batched(self) -> Any:
        return self.env


class _Single:
    """One environment as a vector of one."""

    num_envs = 1

    def __init__(self, env: gym.Env) -> None:
        self.env, self.single_action_space = env, env.action_space

    def reset(self, seed: Sequence[int]) -> tuple[Any, dict[str, Any]]:
        return _with_axis(self.env.reset(seed=seed[0])[0]), {}

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        observation, reward, terminated, truncated, info = self.env.step(actions[0])
        entries = {name: np.array([info[name]]) for name in ("steps", *OUTCOMES) if name in info}
        return _with_axis(observation), np.array([reward]), [terminated], [truncated], entries


class _Log:
    """Log of n environments, chunk by chunk."""

    def __init__(self, count: int) -> None:
        self.lengths = [0] * count
        self.seen: list[dict[str, np.ndarray]] = []
        self.done: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def add(
        self, batch: Mapping[str, Any], actions: np.ndarray, predicted: np.ndarray, info: Any, going: list[bool]
    ) -> None:
        counts = np.array([_last(info, i).get("steps", {i: actions.shape[1]})[i] for i in range(len(going))])
        self.seen.append({name: values[: len(going)].copy() for name, values in flat(batch).items()})
        self.done.append((actions, predicted, counts))
        self.lengths = [length + go for length, go in zip(self.lengths, going, strict=True)]

    def trajectories(self, jobs: Sequence[tuple[int, int]], ends: Sequence[Any]) -> list[Trajectory]:
        result = []
        for i, ((seed, attempt), length) in enumerate(zip(jobs, self.lengths, strict=True)):
            seen = {name: np.stack([one[name][i] for one in self.seen[:length]]) for name in self.seen[0]}
            actions, predicted, counts = (
                np.stack([one[i] for one in part]) for part in zip(*self.done[:length], strict=True)
            )
            result.append(Trajectory(seen, actions, predicted, counts.astype(np.int64), seed, attempt, ends[i]))
        return result


def policy_batch(observation: Any, camera: str = "head") -> dict[str, Any]:
    """Observations (B, ...) of an environment as policies take them: agent_pos (B, n) float32, pixels by camera.

    A single picture gets the camera's name; a state vector alone is agent_pos.
    """
    if not isinstance(observation, Mapping):
        seen = np.asarray(observation)
        observation = {"pixels": seen} if seen.dtype == np.uint8 else {"agent_pos": seen}
    batch = dict(observation)
    if "agent_pos" in batch:
        batch["agent_pos"] = np.asarray(batch["agent_pos"], np.float32)
    if "pixels" in batch and not isinstance(batch["pixels"], Mapping):
        batch["pixels"] = {camera: batch["pixels"]}
    return batch


def outcome(info: Mapping[str, Any], i: int) -> dict[str, float]:
    """Return the outcome of the episode of environment i, from a vector's info.

    Raises: SimulationError if the info has no outcome.
    """
    entries = _last(info, i)
    result = {name: float(np.asarray(entries[name])[i]) for name in OUTCOMES if name in entries}
    if not result:
        raise SimulationError(
            f"the environment's info has no outcome of the episode; it needs one of {', '.join(OUTCOMES)}."
        )
    return result


def _last(info: Mapping[str, Any], i: int) -> Mapping[str, Any]:
    """Return the info of environment i; if it was reset in the same step, the info from before the reset."""
    return info["final_info"] if "final_info" in info and info["_final_info"][i] else info


def _spread(policy: Any, size: int) -> np.ndarray:
    """Size of a normalised unit of each action; 1 for a policy that does not normalise."""
    network = getattr(policy, "network", policy)
    return spread_of(network, size) if hasattr(network, "denormalise") else np.ones(size)


def _check_chunked(space: spaces.Space) -> None:
    if not isinstance(space, spaces.Box) or len(space.shape) != 2:
        raise SimulationError(
            f"rollouts need an environment that takes chunks (k, m), not {space}; wrap it in ActionChunk."
        )


def _with_axis(values: Any) -> Any:
    if isinstance(values, Mapping):
        return {name: _with_axis(value) for name, value in values.items()}
    return np.asarray(values)[None]
