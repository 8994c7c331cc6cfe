"""Make an environment, let the scripted expert do its task, and save a picture. (ten seconds)"""

from __future__ import annotations

import gymnasium as gym
from matplotlib.image import imsave

import embodiedreamer_gym  # noqa: F401  registers the environments
from embodiedreamer_gym.envs.experts import ScriptedExpert


def main() -> None:
    env = gym.make("EmbodieDreamer/PutCupOnMat-v0", render_mode="rgb_array")  # robot="my_arm_calibrated.json"
    observation, info = env.reset(seed=0)
    print({name: array.shape for name, array in observation.items()})

    expert, over = ScriptedExpert(env), False  # or your policy: env.step(policy(observation))
    while not over:
        observation, reward, _, truncated, info = env.step(expert.act())
        over = truncated or info["is_success"]
    print(
        f"{env.unwrapped.task_description}: done {info['is_success']} after {info['sim_time']:.1f} s, reward {reward:.3f}"
    )
    imsave("put_cup_on_mat.png", env.render())
    env.close()


if __name__ == "__main__":
    main()
