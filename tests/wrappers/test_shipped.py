"""The weights and photos that the package ships: they are there, quick, and worth more than copying."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.envs.tasks import TASKS
from embodiedreamer_gym.vis_aligner import load_aligner, load_bank, load_episode
from embodiedreamer_gym.vis_aligner.held_out import AFTER_TRUE, CLOSED, evaluate_aligner
from embodiedreamer_gym.wrappers import VisAlignerObservationWrapper

CLIP = Path(__file__).with_name("lab.hdf5")  # held out: the first 17 frames of `cup_test`, in no training set

COLD = """
import gymnasium as gym, numpy as np, time
import embodiedreamer_gym
from embodiedreamer_gym.wrappers import VisAlignerObservationWrapper
env = VisAlignerObservationWrapper(gym.make("EmbodieDreamer/PutCupOnMat-v0", image_size=(128, 96)))
env.reset(seed=0)
still = np.repeat(env.unwrapped.joint_positions()[None], 8, axis=0).astype(np.float32)
print(env.step(still)[4]["frames"].shape, time.process_time())
"""


def test_a_fresh_process_dreams_within_ten_seconds() -> None:
    """Of processor time, which a busy machine does not lengthen."""
    done = subprocess.run([sys.executable, "-c", COLD], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    shape, _, seconds = done.stdout.splitlines()[-1].rpartition(" ")
    assert shape == "(8, 96, 128, 3)" and float(seconds) < 10.0


def test_weights_and_photos_are_no_larger_than_the_wheel_allows() -> None:
    folder = Path(sys.modules["embodiedreamer_gym"].__file__ or "").parent / "assets" / "vis"
    assert sum(p.stat().st_size for p in folder.iterdir()) < 5e6


@pytest.mark.parametrize("task", TASKS)
def test_every_task_is_dreamed(task: str) -> None:
    """A moved arm shows in the picture; where nothing moves it stays the reference, and no picture is the simulator's."""
    env = VisAlignerObservationWrapper(
        gym.make(f"embodiedreamer_gym:EmbodieDreamer/{task}-v0", image_size=(128, 96), disable_env_checker=True)
    )
    observation, _ = env.reset(seed=3)
    first = observation["pixels"]
    target = env.unwrapped.joint_positions().astype(np.float32)
    target[[1, 8]] += 0.4
    observation, *_, info = env.step(np.repeat(target[None], 8, axis=0))
    simulated = env.unwrapped.capture("head", (128, 96))
    changed = np.abs(info["frames"][-1].astype(int) - first).max(axis=2) > 40
    assert 0.005 < changed.mean() < 0.4
    assert np.abs(observation["pixels"].astype(int) - simulated.rgb).mean() > 20
    env.close()


def test_it_beats_copying_on_a_held_out_clip() -> None:
    """Two chunks of an episode before the lab's bench, after true frames and in the closed loop."""
    found = evaluate_aligner(load_aligner("lean"), load_episode(CLIP), bench=load_bank("lab").bench).measures
    last, true, closed = (found[name] for name in ("copy last", AFTER_TRUE, CLOSED))
    assert true["psnr"] > 30.0 and true["psnr.arm and objects"] > 26.0
    assert true["psnr"] > last["psnr"] + 3.0 and true["psnr.moving"] > last["psnr.moving"] + 5.0
    assert closed["psnr"] > last["psnr"] + 1.0 and closed["psnr.moving"] > last["psnr.moving"] + 4.0
    assert closed["iou.objects"] > 0.9
