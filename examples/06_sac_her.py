"""Train SAC with hindsight on the goal variant: a few steps to see it run, `python 06_sac_her.py 100000` for more."""

from __future__ import annotations

import sys

import gymnasium as gym
from gymnasium.wrappers import RescaleAction
from stable_baselines3 import SAC, HerReplayBuffer

import embodiedreamer_gym  # noqa: F401  registers the environments


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    env = RescaleAction(gym.make("EmbodieDreamer/PutCupOnMatGoal-v0", max_episode_steps=100), -1, 1)
    model = SAC("MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=200, gamma=0.97,
                batch_size=64, device="cpu", seed=0)  # fmt: skip
    model.learn(steps)

    (observation, _), over = env.reset(seed=1), False
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, _, over, _ = env.step(action)
    goal, reached = observation["desired_goal"], observation["achieved_goal"]
    print(f"goal {goal.round(2)} m, reached {reached.round(2)} m, reward {reward:.2f}, {model.num_timesteps} steps")
    env.close()


if __name__ == "__main__":
    main()
