"""Environments: invalid arguments, actions and reset options, and calls in a wrong order."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.fuzzing.case import Case
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.goal import AlohaGoalEnv


class Odd:
    """An object that raises on attribute access, comparison and `repr`."""

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError(name)

    def __repr__(self) -> str:
        raise RuntimeError("no repr")

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("no comparison")


DEEP: list[Any] = []
for _ in range(900):
    DEEP = [DEEP]
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 14, 30, 0.5, -0.0, 1e308, 10**400, 10**9999, float("nan"), float("inf"), 1j, "", "no", "state", "pixels", "head", "aloha", "é", "a" * 9999, "\x00",
    b"x", (), [], {}, set(), {"head"}, ("head", "head"), ["head", "left_wrist"], {"head": 1}, [None], DEEP, (8, 8), (16, 12), (10**6, 10**6), (4097, 8), ("8", "8"), (8.0, 8.0), (True, 64),
    np.zeros(14), np.zeros((14, 1)), np.zeros(0), np.zeros(14, complex), np.full(14, "0.1"), np.full(14, None), np.full(14, np.nan), np.full(14, 1e308), np.full(14, -1e308),
    np.full(14, 10**18), np.zeros(14, bool), np.zeros(14, "datetime64[s]"), np.array(30), np.float32(30), np.int8(30), np.ma.masked_all(14), np.zeros(14, [("a", "f4")]),
    [0.0] * 14, ["0.1"] * 14, [10**400] * 14, [[0.0], [0.0] * 13], range(14), iter(range(14)), {i: 0.0 for i in range(14)}, "0" * 14, b"0" * 14, [True] * 14, [1j] * 14,
    Odd(), Odd, lambda: 0, object(), Path("two.json"), Path("."), Path("/dev/null"), "two.json", "two.urdf", "cameras.json", ".", "none.json", [Odd()] * 14,
)  # fmt: skip
ARGUMENTS = (
    "task",
    "robot",
    "obs_type",
    "cameras",
    "camera_file",
    "image_size",
    "control_hz",
    "renderer",
    "randomize",
    "render_mode",
    "collisions",
    "engine",
)
OPTIONS = ("joint_positions", "joint_velocities", "command", "object_poses", "none", 5, None)
ERRORS = (gym.error.Error, gym.error.ClosedEnvironmentError)
_env: list[Any] = []


def make(**arguments: Any) -> Any:
    """Make an environment without `gymnasium.make`, whose own checks would run first."""
    return AlohaEnv(**{"task": "PutCupOnMat", "obs_type": "state", "renderer": "tiny"} | arguments)


def warm() -> None:
    """Make an environment that every forked case can use."""
    _env.append(make(render_mode="rgb_array"))


def environments(case: Case) -> None:
    """Try one of six kinds of misuse; afterwards a valid step must still work."""
    if not _env:
        warm()
    for name in ("two.json", "two.urdf", "cameras.json"):
        case.copy(name)
    kind = (_arguments, _actions, _actions, _options, _options, _order, _wrapped, _goal)[case.number % 8]
    kind(case, case.rng)


def _value(rng: Random) -> Any:
    return rng.choice(VALUES)


def _some_arguments(rng: Random) -> dict[str, Any]:
    arguments = {rng.choice(ARGUMENTS): _value(rng) for _ in range(rng.choice((1, 1, 2)))}
    if callable(arguments.get("engine")):  # a user's own engine may raise any error
        arguments["engine"] = "none"
    return arguments


def _arguments(case: Case, rng: Random) -> None:
    arguments = _some_arguments(rng)
    made: list[Any] = []
    if case.library(
        f"make({sorted(arguments)})",
        lambda: made.append(make(**arguments)),
        ERRORS,
    ):
        _works(case, made[0])


def _works(case: Case, env: Any) -> None:
    """Check that reset and step work, with observations in their space and a finite reward."""

    def play() -> None:
        observation, _ = env.reset(seed=1)
        case.check("the first observation lies in the space", env.observation_space.contains(observation))
        observation, reward, *_ = env.step(env.action_space.sample())
        case.check("an observation lies in the space", env.observation_space.contains(observation))
        case.check("the reward is finite", np.isfinite(reward))

    case.library("reset and step", play)


def _actions(case: Case, rng: Random) -> None:
    env = _env[0]
    env.reset(seed=0)
    for _ in range(3):
        action = _value(rng)
        case.library("step", lambda action=action: env.step(action), ERRORS)
    case.library("capture", lambda: env.capture(_value(rng), _value(rng)), ERRORS)
    _works(case, env)


def _options(case: Case, rng: Random) -> None:
    env = _env[0]
    options: Any = (
        _value(rng) if rng.random() < 0.2 else {rng.choice(OPTIONS): _value(rng) for _ in range(rng.choice((1, 1, 2)))}
    )
    if rng.random() < 0.3:
        options = {
            "object_poses": {
                rng.choice(("cup", "mat", "none", 5)): rng.choice(
                    (_value(rng), [0.5, 0.1, 0.8, 0, 0, 0, 1.0], [1e9, 0, 0, 0, 0, 0, 1.0])
                )
            }
        }
    seed = rng.choice((0, 0, 0, None, -1, 1.5, "0", 10**400, True, np.int64(3)))
    case.library("reset", lambda: env.reset(seed=seed, options=options), ERRORS)
    _works(case, env)


def _order(case: Case, rng: Random) -> None:
    env = make(render_mode=rng.choice((None, "rgb_array")))
    calls = {"step": lambda: env.step(np.zeros(14)), "render": env.render, "close": env.close, "reset": lambda: env.reset(seed=0), "side": lambda: env.side,
             "command": lambda: env.command, "capture": lambda: env.capture("head", (16, 12)), "observe": env.observe, "situation": env.situation, "joint_positions": env.joint_positions}  # fmt: skip
    ready = False
    for name in rng.choices(sorted(calls), k=6):
        worked = case.library(name, calls[name], ERRORS)
        ready = ready or name == "reset"
        late = name in ("step", "side", "command", "observe", "situation", "joint_positions") or (
            name == "render" and env.render_mode
        )
        case.check(f"{name} needs a reset first", not worked or ready or not late)


def _wrapped(case: Case, rng: Random) -> None:
    from embodiedreamer_gym.wrappers import ActionChunk

    made: list[Any] = []
    if case.library("ActionChunk", lambda: made.append(ActionChunk(_env[0], _value(rng))), ERRORS):
        made[0].reset(seed=0)
        case.library(
            "a chunk",
            lambda: made[0].step(
                rng.choice((_value(rng), np.full((3, 14), rng.choice((0.0, np.nan))), [_value(rng)] * 3))
            ),
            ERRORS,
        )


def _goal(case: Case, rng: Random) -> None:
    arguments = _some_arguments(rng)
    made: list[Any] = []
    allowed = ERRORS
    if case.library(
        f"AlohaGoalEnv({sorted(arguments)})",
        lambda: made.append(AlohaGoalEnv(**{"renderer": "tiny"} | arguments)),
        allowed,
    ):
        _works(case, made[0])
