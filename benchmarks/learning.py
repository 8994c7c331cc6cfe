"""Learning in the environment: PPO from Stable-Baselines3 on the state of PutCupOnMat, with random and still baselines.

python -m benchmarks.learning [--steps 150000] [--seeds 3] [--out FILE.json] [--plot docs/images/learning.png]

The reward is the paper's: minus the distance of the end effector to its target. After each tenth of the steps, the
policy plays 20 unseen episodes without exploration; the figure is the mean distance over the last second of an episode.
A finished seed is kept in --out and not run again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from gymnasium.wrappers import RescaleAction
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import embodiedreamer_gym  # noqa: F401  registers the environments
from benchmarks.common import save

ID = "EmbodieDreamer/PutCupOnMat-v0"
EPISODES, LAST = 20, 30  # unseen episodes, and last steps of each that are evaluated
ENVS = 4
POINTS = 10


def make() -> gym.Env:
    """The environment with its state and actions in -1..1."""
    return RescaleAction(gym.make(ID, obs_type="state"), np.float32(-1.0), np.float32(1.0))


def play(act: Callable[[np.ndarray], np.ndarray], env: gym.Env, first_seed: int = 10_000) -> dict[str, float]:
    """Mean distance (m) of the end effector to its target over the end of unseen episodes, and mean return."""
    ends, returns = [], []
    for k in range(EPISODES):
        observation, info = env.reset(seed=first_seed + k)
        distances, over = [], False
        while not over:
            observation, _, _, over, info = env.step(act(observation))
            distances.append(info["distance"])
        ends.append(np.mean(distances[-LAST:]))
        returns.append(-np.sum(distances))
    return {"distance": float(np.mean(ends)), "return": float(np.mean(returns))}


def baselines() -> dict[str, dict[str, float]]:
    """Baselines: random actions, and an arm that stands still."""
    env, rng = make(), np.random.default_rng(0)
    still = env.unwrapped.action_space
    env.reset(seed=0)
    home = 2 * (env.unwrapped.joint_positions() - still.low) / (still.high - still.low) - 1
    random = play(lambda _: rng.uniform(-1, 1, 14).astype(np.float32), env)
    return {"random": random, "still": play(lambda _: home.astype(np.float32), env)}


def learn(seed: int, steps: int) -> list[dict[str, float]]:
    """Train one policy; returns a row for each evaluation."""
    torch.set_num_threads(1)
    training = VecNormalize(DummyVecEnv([make] * ENVS), gamma=0.97)
    model = PPO("MlpPolicy", training, n_steps=512, batch_size=256, n_epochs=10, gamma=0.97, gae_lambda=0.95,
                learning_rate=3e-4, ent_coef=0.0, clip_range=0.2, seed=seed, device="cpu",
                policy_kwargs={"log_std_init": -1.0, "net_arch": [128, 128]})  # fmt: skip
    env, rows = make(), []
    for point in range(POINTS + 1):
        act = lambda o: model.predict(training.normalize_obs(o), deterministic=True)[0]  # noqa: E731
        rows.append({"steps": model.num_timesteps, **play(act, env)})
        print(f"seed {seed}: {rows[-1]['steps']:>7} steps, distance {rows[-1]['distance']:.3f} m", flush=True)
        if point < POINTS:
            model.learn(steps // POINTS, reset_num_timesteps=False)
    return rows


def draw(found: dict, path: Path) -> None:
    """Draw the curves of all seeds, and the baselines."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    for seed, rows in found["seeds"].items():
        axes.plot([r["steps"] for r in rows], [r["distance"] for r in rows], marker=".", label=f"PPO, seed {seed}")
    for name, style in (("random", "--"), ("still", ":")):
        axes.axhline(found["baselines"][name]["distance"], color="0.4", linestyle=style, label=name)
    axes.set(xlabel="steps", ylabel="distance to the target [m]", title="PutCupOnMat, unseen episodes", ylim=(0, None))
    axes.legend(frameon=False, fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Print the curve and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=150_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    found = json.loads(arguments.out.read_text()) if arguments.out and arguments.out.is_file() else {}
    found.setdefault("seeds", {})
    found.setdefault("baselines", None)
    found["baselines"] = found["baselines"] or baselines()
    for seed in range(arguments.seeds):
        if str(seed) not in found["seeds"]:
            found["seeds"][str(seed)] = learn(seed, arguments.steps)
            save(found, arguments.out)
    last = [rows[-1]["distance"] for rows in found["seeds"].values()]
    print(f"{'':<10}{'distance to the target, last second':>38}{'return':>10}")
    for name, row in found["baselines"].items():
        print(f"{name:<10}{row['distance']:>36.3f} m{row['return']:>10.1f}")
    returns = np.mean([rows[-1]["return"] for rows in found["seeds"].values()])
    print(f"{'PPO':<10}{np.mean(last):>36.3f} m{returns:>10.1f}   seeds: {', '.join(f'{x:.3f}' for x in last)}")
    if arguments.plot:
        draw(found, arguments.plot)


if __name__ == "__main__":
    main()
