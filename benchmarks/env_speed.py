"""Speed of the environment compared with its peers: steps and simulated seconds per CPU second, resets, pictures.

python -m benchmarks.env_speed [--peers panda-gym,gym-aloha,robosuite] [--venvs .venv-peers] [--rounds 15] [--out FILE.json]

Each peer gets its own virtual environment (made once, from the package index; a peer that cannot be installed is left
out with a message). All run interleaved in rounds, one process each, so that a busy machine slows all equally; figures
are medians over rounds of CPU seconds, and ratios are computed within a round.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.common import save

WORKER = """
import json, os, sys, time
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
spent = None
{setup}
for line in sys.stdin:
    begun = time.process_time() if spent is None else spent[0]
    for _ in range(int(line)):
        work()
    ended = time.process_time() if spent is None else spent[0]
    print(json.dumps(ended - begun), file=answers, flush=True)
"""
OURS = """
import gymnasium as gym, numpy as np, embodiedreamer_gym
env = gym.make("EmbodieDreamer/PutCupOnMat-v0", {arguments}).unwrapped
env.reset(seed=0)
home = env.joint_positions().astype(np.float32)
rng = np.random.default_rng(0)
def work():
    env.step(home + 0.1 * rng.standard_normal(14).astype(np.float32))
"""
RESET = """
seeds = iter(range(10**9))
def work():
    env.reset(seed=next(seeds))
"""
RAW = """
plant, step, spent = env.engine.plant, env.engine.client.stepSimulation, [0.0]
def timed():
    begun = time.process_time()
    step()
    spent[0] += time.process_time() - begun
plant._bodies._advance = timed
"""
PANDA = """
import gymnasium as gym, panda_gym
env = gym.make("PandaPickAndPlace-v3").unwrapped
env.reset(seed=0)
def work():
    env.step(env.action_space.sample())
"""
ALOHA = """
os.environ["MUJOCO_GL"] = "egl"
import gymnasium as gym, gym_aloha
env = gym.make("gym_aloha/AlohaTransferCube-v0", obs_type="pixels_agent_pos").unwrapped
env.reset(seed=0)
def work():
    env.step(env.action_space.sample())
"""
ROBOSUITE = """
import robosuite, numpy as np
env = robosuite.make("TwoArmLift", robots=["Panda", "Panda"], has_renderer=False, has_offscreen_renderer=False,
                     use_camera_obs=False, control_freq=20, horizon=10**9)
env.reset()
low, high = env.action_spec
def work():
    env.step(np.random.uniform(low, high))
"""
PEERS = {  # name -> what to install, worker, seconds simulated per step
    "panda-gym": (["panda-gym==3.0.7"], PANDA, 0.04),
    "gym-aloha": (["gym-aloha==0.1.5"], ALOHA, 0.02),
    "robosuite": (["robosuite==1.5.2", "mujoco==3.3.7", "h5py", "gymnasium"], ROBOSUITE, 0.05),
}
EFFECTS = {  # effects of the calibrated robot: one or two for each stage of the signal chain
    "command_delay.seconds": 0.02, "command_rate_limit.rate": 2.5, "coulomb_friction.torque": 0.2,
    "torque_saturation.torque": 20.0, "torque_bias.torque": 0.1, "payload.mass": 0.1,
}  # fmt: skip
TRIALS = {"state": 40, "pixels": 4, "reset": 30}  # calls in a round


def calibrated(folder: Path) -> str:
    """Write a robot with six effects and intervals, as a calibration does; return the file's path."""
    from embodiedreamer_gym.robot import RobotModel

    model = RobotModel.load("aloha")
    for name in dict.fromkeys(key.split(".")[0] for key in EFFECTS):
        model = model.with_effect(name)
    rows = {row.name: row for row in model.parameters()}
    values: dict[str, dict[str, float]] = {}
    for key, value in EFFECTS.items():
        for row in rows.values():
            if str(row.key.group) == key and "gripper" not in row.key.place.removesuffix("_tip").removesuffix(
                "_gripper"
            ):
                values.setdefault(key, {})[row.key.place] = float(min(max(value, row.low), row.high))
    intervals = {f"payload.mass[{arm}]": (0.05, 0.15) for arm in model.arms}
    model.with_values(values, intervals).save(folder / "calibrated.json")
    return str(folder / "calibrated.json")


class Worker:
    """A process that runs its work a given number of times and reports the CPU time."""

    def __init__(self, python: str, setup: str) -> None:
        script = WORKER.format(setup=setup)
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        self._process = subprocess.Popen(
            [python, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=environment,
        )  # fmt: skip

    def run(self, times: int) -> float:
        """CPU seconds per call."""
        process = self._process
        process.stdin.write(f"{times}\n")
        process.stdin.flush()
        answer = process.stdout.readline()
        if not answer:
            raise RuntimeError(process.stderr.read().strip().splitlines()[-1:])
        return json.loads(answer) / times

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


def peer_python(name: str, folder: Path) -> str | None:
    """Interpreter of a peer's own virtual environment, made if missing; None if the peer cannot be installed."""
    home = folder / name
    python = home / "bin" / "python"
    if not (home / ".installed").exists():
        print(f"installing {name} into {home} ...", flush=True)
        subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)
        done = subprocess.run(
            [str(python), "-m", "pip", "install", "--quiet", *PEERS[name][0]], capture_output=True, text=True
        )
        if done.returncode:
            print(f"{name} left out, it cannot be installed: {done.stderr.strip().splitlines()[-1]}")
            return None
        (home / ".installed").touch()
    return str(python)


def workers(peers: list[str], venvs: Path, robot: str) -> dict[str, tuple[Worker, int, float]]:
    """Name -> process, calls per round, seconds that a call simulates."""
    state, pixels = 'obs_type="state"', "image_size=(640, 480)"
    random = f'{state}, robot="{robot}"'
    mine = {
        "ours, state": (OURS.format(arguments=state), TRIALS["state"], 1 / 30),
        "ours, state, six effects": (OURS.format(arguments=random), TRIALS["state"], 1 / 30),
        "ours, MuJoCo, state": (OURS.format(arguments=f'{state}, engine="mujoco"'), TRIALS["state"], 1 / 30),
        "ours, MuJoCo, six effects": (OURS.format(arguments=f'{random}, engine="mujoco"'), TRIALS["state"], 1 / 30),
        "its stepSimulation alone": (OURS.format(arguments=state) + RAW, TRIALS["state"], 1 / 30),
        "ours, 640x480": (OURS.format(arguments=pixels), TRIALS["pixels"], 1 / 30),
        "ours, 128x96": (OURS.format(arguments=""), TRIALS["state"], 1 / 30),
        "reset": (OURS.format(arguments=state) + RESET, TRIALS["reset"], 0.0),
        "reset, masses redrawn": (OURS.format(arguments=random + ', randomize="calibration"') + RESET, TRIALS["reset"], 0.0),
    }  # fmt: skip
    found = {name: (Worker(sys.executable, setup), times, seconds) for name, (setup, times, seconds) in mine.items()}
    for peer in peers:
        python = peer_python(peer, venvs)
        if python:
            times = TRIALS["pixels" if peer == "gym-aloha" else "state"]
            found[peer] = (Worker(python, PEERS[peer][1]), times, PEERS[peer][2])
    return found


def main() -> None:
    """Print the table and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peers", default=",".join(PEERS))
    parser.add_argument("--venvs", type=Path, default=Path(".venv-peers"))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        running = workers([p for p in arguments.peers.split(",") if p], arguments.venvs, calibrated(Path(folder)))
        times = measure(running, arguments.rounds)
    rows = {}
    print(f"{'':<28}{'CPU ms per call':>16}{'calls per CPU s':>18}{'simulated s per CPU s':>24}")
    for name, spent in times.items():
        middle = median(spent)
        simulated = running[name][2] / middle
        rows[name] = {"ms": 1e3 * middle, "spread_ms": [1e3 * min(spent), 1e3 * max(spent)], "simulated": simulated}
        print(f"{name:<28}{1e3 * middle:>16.3f}{1 / middle:>18.0f}{simulated:>24.1f}")
    print()
    for line, value in ratios(times, {name: item[2] for name, item in running.items()}):
        rows[line] = value
        print(f"{line}: {value:.2f}")
    save(rows, arguments.out)


def measure(running: dict[str, tuple[Worker, int, float]], rounds: int) -> dict[str, list[float]]:
    """CPU seconds per call of each worker in each round, after a warm-up round; failing workers are left out."""
    times: dict[str, list[float]] = {}
    for turn in range(rounds + 1):
        for name, (worker, count, _) in running.items():
            if turn and name not in times:
                continue
            try:
                spent = worker.run(count)
            except RuntimeError as error:
                print(f"{name} left out: {error}")
                continue
            if not turn:
                times[name] = []
            else:
                times[name].append(spent)
        print(f"\rround {turn} of {rounds}", end="" if turn < rounds else "\n", file=sys.stderr, flush=True)
    for worker, _, _ in running.values():
        worker.stop()
    return {name: spent for name, spent in times.items() if spent}


def ratios(times: dict[str, list[float]], seconds: dict[str, float]):
    """Ratios between workers, medians over rounds."""

    def of(mine: str, theirs: str) -> float:
        pairs = zip(times[mine], times[theirs], strict=True)
        return median((seconds[mine] / a) / (seconds[theirs] / b) for a, b in pairs)

    if "panda-gym" in times:
        yield "simulated seconds per CPU second, over panda-gym PickAndPlace", of("ours, state", "panda-gym")
        yield "the same with six effects", of("ours, state, six effects", "panda-gym")
        yield "the same on MuJoCo", of("ours, MuJoCo, state", "panda-gym")
        yield "the same on MuJoCo with six effects", of("ours, MuJoCo, six effects", "panda-gym")
    if "robosuite" in times:
        yield "simulated seconds per CPU second, over robosuite TwoArmLift", of("ours, state, six effects", "robosuite")
        yield "the same on MuJoCo with six effects, over robosuite", of("ours, MuJoCo, six effects", "robosuite")
    if "gym-aloha" in times:
        yield (
            "steps per CPU second at 640x480, over gym-aloha",
            median(b / a for a, b in zip(times["ours, 640x480"], times["gym-aloha"], strict=True)),
        )
    share = [b / a for a, b in zip(times["ours, state"], times["its stepSimulation alone"], strict=True)]
    yield "share of a state step that is raw stepSimulation", median(share)


if __name__ == "__main__":
    main()
