"""Train ACT on demonstrations and evaluate it on held-out scenes; 20 steps here, 8000 to be useful. (half a minute)"""

from __future__ import annotations

import gymnasium as gym

import embodiedreamer_gym
from embodiedreamer_gym.pipelines.demonstrations import Demonstrations, record_demonstrations
from embodiedreamer_gym.policies import evaluate
from embodiedreamer_gym.policies.act import ActConfig, TrainingConfig, train, with_object_poses
from embodiedreamer_gym.recordings.episodes import open_episodes


def main() -> None:
    record_demonstrations(Demonstrations("GrabPaperCup", size=(64, 48)), 2, "demos")  # 50 for a useful policy
    episodes = open_episodes("demos")  # a folder of real logs or a LeRobot data set works too

    config = ActConfig(episodes.state_size, episodes.action_size, episodes.cameras, image_size=(64, 48))
    config = with_object_poses(config, episodes)  # if the data has masks of objects
    policy = train(episodes, config, TrainingConfig(steps=20, batch=8), "act")  # continues an interrupted training

    env = gym.make("EmbodieDreamer/GrabPaperCup-v0", image_size=(64, 48))
    print(embodiedreamer_gym.__version__, policy)
    print(evaluate(policy, env, seeds=[100_000]))
    env.close()


if __name__ == "__main__":
    main()
