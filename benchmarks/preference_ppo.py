"""PPO from Stable-Baselines3 on the twin, from the supervised policy's weights: chunks as actions, one final reward."""

from __future__ import annotations

import copy
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from benchmarks.preference_twin import ACTIONS, PLAYED, STATES, STEPS, ChunkMlp, Twin

CHUNKS = STEPS // PLAYED  # chunks per episode


class Arms(VecEnv):
    """N twins that reset together: normalised states and chunks (PLAYED * 4,); final reward: minus the metric."""

    def __init__(self, count: int, network: ChunkMlp, metric: str, seeds: Sequence[int]) -> None:
        self.twin, self.scale, self.metric, self.seeds, self.at = Twin(count), network, metric, seeds, 0
        space = spaces.Box(-10, 10, (PLAYED * ACTIONS,), np.float32)
        super().__init__(count, spaces.Box(-np.inf, np.inf, (STATES,), np.float32), space)

    def reset(self) -> np.ndarray:
        """Reset to the next starts."""
        chosen = [self.seeds[(self.at + i) % len(self.seeds)] for i in range(self.num_envs)]
        self.at += self.num_envs
        return self._seen(self.twin.reset(seed=chosen)[0])

    def step_async(self, actions: np.ndarray) -> None:
        """Store the chunks."""
        self.actions = torch.from_numpy(actions).unflatten(1, (PLAYED, ACTIONS))

    def step_wait(self) -> tuple[Any, ...]:
        """Play the stored chunks."""
        space = self.twin.single_action_space
        played = np.clip(self.scale.denormalise(self.actions).numpy(), space.low, space.high)
        observation, _, _, over, info = self.twin.step(played)
        seen, told = self._seen(observation), [{} for _ in over]
        reward = np.where(over, -info[self.metric], 0.0)
        if over.all():
            told = [{"terminal_observation": one} for one in seen]
            seen = self.reset()
        return seen, reward.astype(np.float32), over, told

    def _seen(self, observation: Any) -> np.ndarray:
        return self.scale.states(observation).numpy()

    def close(self) -> None:
        """Do nothing; there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same attribute for all environments."""
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Do nothing; attributes cannot be set."""

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Return None for each environment; there are no methods."""
        return [None] * self.num_envs

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each environment."""
        return [False] * self.num_envs


def layers(model: PPO, network: ChunkMlp) -> list[tuple[nn.Linear, nn.Linear, int]]:
    """Layers of PPO's actor, the matching layers of the network, and the number of rows they share."""
    found = [one for one in model.policy.mlp_extractor.policy_net if isinstance(one, nn.Linear)]
    rows = [128, 128, PLAYED * ACTIONS]
    return list(
        zip([*found, model.policy.action_net], [network.body[0], network.body[2], network.head], rows, strict=True)
    )


def learn(
    seed: int,
    network: ChunkMlp,
    cycles: int,
    starts: Any,
    tries: int,
    noise: float,
    metric: str,
    judge: Any,
    rate: float,
) -> dict[str, Any]:
    """One update per cycle, each with as many episodes as the other methods play; returns a row per evaluation."""
    began, count = time.process_time(), len(starts(0))
    seeds = [one for cycle in range(cycles) for one in starts(cycle) * tries]
    model = PPO("MlpPolicy", Arms(count, copy.deepcopy(network), metric, seeds), n_steps=CHUNKS * tries, seed=seed,
                batch_size=count * CHUNKS, n_epochs=10, learning_rate=rate, gamma=1.0, gae_lambda=0.95, device="cpu",
                policy_kwargs={"net_arch": {"pi": [128, 128], "vf": [128, 128]}, "activation_fn": nn.ReLU,
                               "log_std_init": float(np.log(noise))})  # fmt: skip
    with torch.no_grad():
        for one, other, rows in layers(model, network):
            one.weight.copy_(other.weight[:rows])
            one.bias.copy_(other.bias[:rows])
    rows = [judge(network)]
    for cycle in range(cycles):
        model.learn(count * CHUNKS * tries, reset_num_timesteps=False)
        with torch.no_grad():
            for one, other, shared in layers(model, network):
                other.weight[:shared] = one.weight
                other.bias[:shared] = one.bias
        rows.append(judge(network) | {"remark": f"{model.num_timesteps} chunks"})
        print(f"ppo, seed {seed}, cycle {cycle + 1}: {rows[-1]['is_success']:.1%}", flush=True)
    return {"method": "ppo", "seed": seed, "rows": rows, "cpu_s": time.process_time() - began}
