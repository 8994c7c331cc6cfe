"""Roll out a policy several times per start, rank the tries, and fine-tune it to prefer better ones. (ten seconds)"""

from __future__ import annotations

import gymnasium as gym

import embodiedreamer_gym
from embodiedreamer_gym.policies.act import Act, ActConfig, ActPolicy
from embodiedreamer_gym.policies.preferences import PreferenceSet, TuningConfig, fine_tune
from embodiedreamer_gym.wrappers.preference_rollout import PreferenceRolloutWrapper


def main() -> None:
    # For your own policy: embodiedreamer_gym.policies.load_policy("act"); this one is untrained.
    policy = ActPolicy(Act(ActConfig(14, 14, ("head",), (64, 48), chunk=20)))

    env = gym.make("EmbodieDreamer/PutCupOnMat-v0", image_size=(64, 48))
    env = PreferenceRolloutWrapper(env, tries=3, noise=0.3, chunk=20, chunks=2)  # without chunks: whole episodes
    rollouts = list(env.rollouts(policy, seeds=[1, 2]))
    env.close()

    pairs = PreferenceSet.choose(rollouts, metric="distance", margin=0.0)  # best against worst of each start
    tuned = fine_tune(policy.network, pairs, TuningConfig(epochs=2))
    print(embodiedreamer_gym.__version__, pairs)
    print("log-likelihoods of winners", tuned.winner, "and losers", tuned.loser)
    policy.save("preferred")


if __name__ == "__main__":
    main()
