"""Low-dimensional twin of PutCupOnMat: a kinematic arm, a cup and a mat, vectorised in NumPy; no physics, no frames.

An episode has sixty steps at 10 Hz. In each step the arm (yaw, shoulder, elbow) moves part of the way to its target. A
gripper that closes with its tip within 2 cm of the cup's middle grasps it; opening drops it. Cup and mat are placed at
random in 16 x 15 cm. Success: the cup is released within 3.5 cm of the mat's middle. A scripted expert gives
demonstrations.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from torch import nn

from embodiedreamer_gym.policies.preferences import Trajectory

STEPS, CHUNK, PLAYED = 60, 20, 10  # steps of an episode, actions of a chunk, actions played of each chunk
LINKS = (0.25, 0.25)  # m
BASE = 0.10  # m, height of the shoulder
GRIP = 0.04  # m, height of the cup's middle above its foot
NEAR, ON_MAT = 0.02, 0.035  # m
AREA = ((0.20, 0.36), (-0.075, 0.075))  # m, range of cup and mat positions
APART = 0.08  # m, least distance between cup and mat
LAG, FASTEST = 0.8, 0.15  # share of the way moved in a step; largest move in a step, rad
HOME = np.array([0.0, 0.9, -1.6])  # rad
STATES, ACTIONS = 11, 4


def forward(q: np.ndarray) -> np.ndarray:
    """Tip position (..., 3) m for joint angles (..., 3)."""
    yaw, shoulder, elbow = np.moveaxis(q, -1, 0)
    reach = LINKS[0] * np.cos(shoulder) + LINKS[1] * np.cos(shoulder + elbow)
    height = BASE + LINKS[0] * np.sin(shoulder) + LINKS[1] * np.sin(shoulder + elbow)
    return np.stack([reach * np.cos(yaw), reach * np.sin(yaw), height], -1)


def inverse(tip: np.ndarray) -> np.ndarray:
    """Joint angles (..., 3) for a tip position (..., 3), elbow up; targets out of reach are clipped."""
    x, y, z = np.moveaxis(tip, -1, 0)
    reach, height = np.hypot(x, y), z - BASE
    far = np.clip(np.hypot(reach, height), 0.05, sum(LINKS) - 1e-6)
    bend = np.arccos(np.clip((far**2 - LINKS[0] ** 2 - LINKS[1] ** 2) / (2 * LINKS[0] * LINKS[1]), -1, 1))
    shoulder = np.arctan2(height, reach) + np.arctan2(LINKS[1] * np.sin(bend), LINKS[0] + LINKS[1] * np.cos(bend))
    return np.stack([np.arctan2(y, x), shoulder, -bend], -1)


class Twin(VectorEnv):
    """N episodes at once; action (N, PLAYED, 4): joint targets (rad) and gripper (0 closed, 1 open), observation agent_pos."""

    def __init__(self, num_envs: int, played: int = PLAYED) -> None:
        self.num_envs, self.played = num_envs, played
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        low, high = np.array([-1.5, -1.0, -2.8, 0.0]), np.array([1.5, 2.2, 0.0, 1.0])
        one = np.float32(np.stack([low] * played)), np.float32(np.stack([high] * played))
        self.single_action_space = spaces.Box(*one)
        self.action_space = spaces.Box(*(np.float32(np.stack([b] * num_envs)) for b in one))
        self.single_observation_space = spaces.Dict({"agent_pos": spaces.Box(-4, 4, (STATES,))})
        self.observation_space = spaces.Dict({"agent_pos": spaces.Box(-4, 4, (num_envs, STATES))})

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Place cup and mat at random, with one seed per episode."""
        places = np.stack([scene(int(one)) for one in seed])
        self.cup, self.mat = (np.concatenate([places[:, i], np.zeros((self.num_envs, 1))], 1) for i in (0, 1))
        self.q, self.gripper = np.tile(HOME, (self.num_envs, 1)), np.ones(self.num_envs)
        self.held, self.grasped = np.zeros(self.num_envs, bool), np.zeros(self.num_envs, bool)
        self.time = 0
        return self.observe(), self.told()

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        """Play a chunk."""
        for one in np.moveaxis(np.asarray(actions, float), 1, 0):
            self.move(one)
        over = np.full(self.num_envs, self.time >= STEPS)
        info = self.told()
        return self.observe(), -info["distance"], np.zeros(self.num_envs, bool), over, info

    def move(self, action: np.ndarray) -> None:
        """Simulate one step."""
        self.q = self.q + np.clip(LAG * (action[:, :3] - self.q), -FASTEST, FASTEST)
        self.gripper = self.gripper + np.clip(action[:, 3] - self.gripper, -0.5, 0.5)
        tip, closed = forward(self.q), self.gripper < 0.5
        near = np.linalg.norm(tip - self.cup - [0, 0, GRIP], axis=1) < NEAR
        self.held = closed & (self.held | near)
        self.grasped |= self.held
        self.cup = np.where(self.held[:, None], tip - [0, 0, GRIP], self.cup * [1, 1, 0])
        self.time += 1

    def observe(self) -> dict[str, np.ndarray]:
        """Joints, gripper, cup, mat, tip's height and whether the cup is held (N, STATES)."""
        parts = [self.q, self.gripper[:, None], self.cup, self.mat[:, :2], forward(self.q)[:, 2:], self.held[:, None]]
        return {"agent_pos": np.concatenate(parts, 1).astype(np.float32)}

    def told(self) -> dict[str, np.ndarray]:
        """Distances (m) of tip and cup to the mat, and whether grasp and task have succeeded."""
        off = np.linalg.norm((self.cup - self.mat)[:, :2], axis=1)
        return {
            "distance": np.linalg.norm(forward(self.q) - self.mat - [0, 0, GRIP], axis=1),
            "object_distance": np.linalg.norm(self.cup - self.mat, axis=1),
            "is_success": self.grasped & ~self.held & (off < ON_MAT),
            "grasp_success": self.grasped.copy(),
        }


def scene(seed: int) -> np.ndarray:
    """Cup and mat (2, 2) of a seed, m."""
    rng, (low, high) = np.random.default_rng(seed), np.array(AREA).T
    while True:
        places = rng.uniform(low, high, (2, 2))
        if np.linalg.norm(places[0] - places[1]) > APART:
            return places


def demonstrate(seeds: list[int]) -> list[Trajectory]:
    """The expert's episodes, as windows of CHUNK actions at each step; the last action is repeated at the end."""
    env = Twin(len(seeds), 1)
    observation, _ = env.reset(seed=seeds)
    cup, mat = (place + np.array([0, 0, GRIP]) for place in (env.cup, env.mat))
    up = np.array([0, 0, 0.08])
    #          tip       gripper, steps
    plan = [(cup + up, 1, 12), (cup, 1, 8), (cup, 0, 3), (cup + up, 0, 7), (mat + up, 0, 12), (mat, 0, 8), (mat, 1, 10)]
    seen, done, start = [], [], forward(env.q)
    for goal, gripper, count in plan:
        for share in np.arange(1, count + 1) / count:
            smooth = share * share * (3 - 2 * share)
            target = inverse(start + smooth * (goal - start))
            action = np.concatenate([target, np.full((len(seeds), 1), gripper)], 1)
            seen.append(observation["agent_pos"])
            done.append(action)
            observation, *_, info = env.step(action[:, None])
        start = goal
    seen, done = np.stack(seen, 1), np.stack(done, 1).astype(np.float32)
    late = np.minimum(np.arange(STEPS)[:, None] + np.arange(CHUNK), STEPS - 1)
    counts = np.full(STEPS, CHUNK)
    return [
        Trajectory({"agent_pos": s}, d[late], d[late], counts, seed, 0, {k: float(v[i]) for k, v in info.items()})
        for i, (seed, s, d) in enumerate(zip(seeds, seen, done, strict=True))
    ]


class ChunkMlp(nn.Module):
    """A multilayer perceptron from states to chunks, normalised by statistics of its demonstrations."""

    def __init__(self, demos: list[Trajectory], width: int = 128) -> None:
        super().__init__()
        states = torch.from_numpy(np.concatenate([d.observations["agent_pos"] for d in demos]))
        actions = torch.from_numpy(np.concatenate([d.actions[:, 0] for d in demos]))
        for name, values in (("state", states), ("action", actions)):
            self.register_buffer(f"{name}_mean", values.mean(0))
            self.register_buffer(f"{name}_scale", values.std(0).clamp(min=1e-2))
        self.body = nn.Sequential(nn.Linear(STATES, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU())
        self.head = nn.Linear(width, CHUNK * ACTIONS)

    @property
    def network(self) -> ChunkMlp:
        """The network that is fine-tuned."""
        return self

    def states(self, batch: Mapping[str, Any]) -> torch.Tensor:
        """Normalised states (B, n)."""
        return (torch.as_tensor(batch["agent_pos"]) - self.state_mean) / self.state_scale

    def mean(self, batch: Mapping[str, Any]) -> torch.Tensor:
        """Normalised chunks (B, CHUNK, 4)."""
        return self.head(self.body(self.states(batch))).unflatten(1, (CHUNK, ACTIONS))

    def normalise(self, actions: torch.Tensor) -> torch.Tensor:
        """Normalise actions."""
        return (actions - self.action_mean) / self.action_scale

    def denormalise(self, actions: torch.Tensor) -> torch.Tensor:
        """Convert normalised actions to the arm's actions."""
        return actions * self.action_scale + self.action_mean

    def forward(self, batch: Mapping[str, Any]) -> np.ndarray:
        """Act as a policy: chunks (B, CHUNK, 4) for a batch of observations."""
        with torch.no_grad():
            return self.denormalise(self.mean(batch)).numpy()
