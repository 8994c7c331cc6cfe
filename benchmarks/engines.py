"""Engine comparison: how far the robot diverges between PyBullet and MuJoCo under the same actions.

python -m benchmarks engines [--seeds 5] [--seconds 4] [--out FILE.json]

Smooth joint targets near home, without contact; the nominal ALOHA and one with six effects. Differences of the encoder
readings in mrad (thousandths of a gripper's stroke): the largest, and the root mean square.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common import save
from benchmarks.env_speed import calibrated
from embodiedreamer_gym.envs.aloha import AlohaEnv
from embodiedreamer_gym.envs.robots import home

SWING = 0.3  # rad


def targets(env: AlohaEnv, seed: int, seconds: float) -> np.ndarray:
    """Joint targets (T, 14): a sum of three sines for each joint, which starts at rest."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * env.control_hz))[:, None] / env.control_hz
    size = SWING * np.array([unit == "rad" for unit in env.robot.units])
    waves = (rng.uniform(-1, 1, env.robot.n) * np.sin(2 * np.pi * hz * time) for hz in (0.3, 0.7, 1.3))
    return home(env.robot) + size * sum(waves, np.zeros((len(time), env.robot.n))) * np.minimum(time, 1.0)


def positions(engine: str, robot: str, seed: int, seconds: float) -> np.ndarray:
    """Encoder readings (T, 14)."""
    env = AlohaEnv(robot=robot, engine=engine, obs_type="state", collisions=False)
    env.reset(seed=0)
    rows = []
    for target in targets(env, seed, seconds):
        env.step(target)
        rows.append(env.joint_positions())
    env.close()
    return np.array(rows)


def main() -> None:
    """Print one line for each robot."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    rows = {}
    print(f"{'robot':<14}{'largest, mrad':>15}{'rms, mrad':>12}   (target: 0.1)")
    with tempfile.TemporaryDirectory() as folder:
        for name, robot in (("nominal", "aloha"), ("six effects", calibrated(Path(folder)))):
            apart = 1e3 * np.array([
                positions("bullet", robot, seed, arguments.seconds) - positions("mujoco", robot, seed, arguments.seconds)
                for seed in range(arguments.seeds)
            ])  # fmt: skip
            rows[name] = {"largest": float(np.abs(apart).max()), "rms": float(np.sqrt((apart**2).mean()))}
            print(f"{name:<14}{rows[name]['largest']:>15.2g}{rows[name]['rms']:>12.2g}")
    save(rows, arguments.out)


if __name__ == "__main__":
    main()
