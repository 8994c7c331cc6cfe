"""Train PPO on the state: a few steps to see it run, `python 05_train_ppo.py 150000` to see it learn."""

from __future__ import annotations

import sys

import gymnasium as gym
from gymnasium.wrappers import RescaleAction
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import embodiedreamer_gym  # noqa: F401  registers the environments


def make() -> gym.Env:
    return RescaleAction(gym.make("EmbodieDreamer/PutCupOnMat-v0", obs_type="state"), -1, 1)  # from rad to -1 .. 1


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 512
    training = VecNormalize(DummyVecEnv([make] * 2), gamma=0.97)
    model = PPO("MlpPolicy", training, n_steps=min(512, steps // 2), batch_size=128, gamma=0.97, device="cpu", seed=0,
                policy_kwargs={"log_std_init": -1.0})  # fmt: skip
    model.learn(steps)

    env, over = make(), False
    observation, info = env.reset(seed=1)
    print(f"the hand is {info['distance']:.2f} m from its target at first", end=", ")
    while not over:
        action, _ = model.predict(training.normalize_obs(observation), deterministic=True)
        observation, _, _, over, info = env.step(action)
    print(f"{info['distance']:.2f} m at last, after {model.num_timesteps} steps of training")


if __name__ == "__main__":
    main()
