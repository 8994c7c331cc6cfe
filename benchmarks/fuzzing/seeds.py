"""Valid files of every kind that users hand over, as small as they can be, written by the package's own writers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

SIZE = (16, 12)  # of pictures
STEPS = 6  # of an episode
TRAIN = ("--steps", "2", "--batch", "2", "--chunk", "4", "--size", "16x12", "--quiet")


def write_seeds(folder: Path) -> None:
    """Write all seeds into a folder; the same bytes each time."""
    for write in (_recordings, _sage, _other_logs, _episodes, _lerobot_set, _policies, _vision, _training):
        write(folder)


def _recordings(folder: Path) -> None:
    """The two-joint arm's model and URDF, and a log of it as csv and as HDF5 with a camera."""
    from embodiedreamer_gym.envs.cameras import CAMERAS, save_cameras
    from embodiedreamer_gym.recordings import save_recording
    from tests.two_joint_arm import load_arm, record, wave, write_arm

    model = load_arm(folder)
    path = write_arm(folder, effects=[])
    data = json.loads(path.read_text())
    data |= {"name": "two", "command_hold": "linear", "intervals": {"stiffness[elbow]": [20.0, 30.0]}}
    data["effects"] = [{"name": "coulomb_friction", "torque": {"shoulder": 0.1, "elbow": 0.05}}]
    path.write_text(json.dumps(data))
    urdf = (folder / "two.urdf").read_text()
    for mass, shape in (("1.0", 'box size="0.25 0.05 0.05"'), ("0.6", 'cylinder radius="0.03" length="0.2"')):
        visual = f"<visual><geometry><{shape}/></geometry></visual>"
        at = urdf.index("</link>", urdf.index(f'<mass value="{mass}"/>'))
        urdf = urdf[:at] + visual + urdf[at:]
    (folder / "two.urdf").write_text(urdf)
    log = record(model, "wave_1", noise=1e-4, command=wave(1.6))
    save_recording(log, folder / "log.csv")
    frames = {"head": list(_pictures(len(log.time)))}
    save_recording(log.with_(frames=frames), folder / "log.hdf5")
    save_cameras(CAMERAS, folder / "cameras.json")


def _pictures(count: int, first: int = 0) -> Iterator[np.ndarray]:
    for k in range(count):
        frame = np.full((SIZE[1], SIZE[0], 3), 10 + (first + k) % 200, np.uint8)
        frame[:4] += 30
        yield frame


def _sage(folder: Path) -> None:
    """A SAGE folder of the two-joint arm."""
    sage = folder / "sage"
    sage.mkdir()
    time = np.arange(60) * 20_000.0
    position = 0.1 * np.sin(time * 4e-6)
    state = [f'STATE_MOTOR,{t},"[{x}, {-x}]","[0.0, 0.0]","[{x}, 0.5]"' for t, x in zip(time, position, strict=True)]
    control = [f'CONTROL,{t},"[{x}, {-x}]"' for t, x in zip(time, position, strict=True)]
    (sage / "state_motor.csv").write_text("\n".join(["type,timestamp,positions,velocities,torques", *state]) + "\n")
    (sage / "control.csv").write_text("\n".join(["type,timestamp,positions", *control]) + "\n")
    (sage / "joint_list.txt").write_text("shoulder\nelbow\n")


def _other_logs(folder: Path) -> None:
    """The log as a LeRobot set, MCAP and rosbag2, and LeRobot's calibration of two motors."""
    from benchmarks.bags import write_mcap, write_rosbag2
    from embodiedreamer_gym.recordings import load_recordings
    from embodiedreamer_gym.recordings.episodes import LeRobotWriter

    (log,) = load_recordings(folder / "log.csv")
    with LeRobotWriter(folder / "lerobot_log", 100, [f"{joint}.pos" for joint in log.joints]) as writer:
        writer.add_episode(log.position, log.command, {}, "wave")
    write_mcap(log, folder / "log.mcap")
    write_rosbag2(log, folder / "bag")
    write_rosbag2(log, folder / "bag_mcap", mcap=True)
    motor = {"drive_mode": 0, "homing_offset": 12, "range_min": 800, "range_max": 3200}
    motors = {joint: {"id": k, **motor} for k, joint in enumerate(log.joints, 1)}
    (folder / "motors.json").write_text(json.dumps(motors))


def _numbers(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 0.1, (STEPS, 14)).astype(np.float32), rng.normal(0, 0.1, (STEPS, 14)).astype(np.float32)


def _episodes(folder: Path) -> None:
    """HDF5 episodes of the ALOHA with a camera and poses."""
    from embodiedreamer_gym.recordings.episodes import AlohaWriter

    poses = {"cup": np.tile([0.5, 0.1, 0.8, 0, 0, 0, 1.0], (STEPS, 1))}
    for name, images in (("episodes", "gzip"), ("jpegs", "jpeg")):
        with AlohaWriter(folder / name, 30, images) as writer:
            for seed in range(2 if images == "gzip" else 1):
                writer.add_episode(*_numbers(seed), {"head": _pictures(STEPS, seed)}, "PutCupOnMat", objects=poses)


def _lerobot_set(folder: Path) -> None:
    from embodiedreamer_gym.recordings.episodes import LeRobotWriter

    with LeRobotWriter(folder / "lerobot_set", 30) as writer:
        for seed in range(2):
            writer.add_episode(*_numbers(seed), {"head": _pictures(STEPS, seed)}, "put")


def _policies(folder: Path) -> None:
    """A policy of this package, and one as LeRobot writes it."""
    import torch

    from embodiedreamer_gym.policies.act import Act, ActPolicy
    from tests.policies.act.test_lerobot import checkpoint
    from tests.policies.act.tiny import CONFIG

    torch.manual_seed(0)
    ActPolicy(Act(CONFIG)).save(folder / "policy")
    checkpoint(folder / "lerobot_policy")


def _vision(folder: Path) -> None:
    """An episode with its simulated view, a reference bank, and weights of a tiny video model."""
    import torch

    from embodiedreamer_gym.pipelines.prepare import write_episode
    from embodiedreamer_gym.vis_aligner import make_bank, save_bank
    from embodiedreamer_gym.vis_aligner.checkpoint import save_lean
    from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
    from tests.vis_aligner.scenes import episode

    torch.manual_seed(0)
    save_lean(Lean(LeanConfig((8, 8, 8, 16))), 3, folder / "lean.pt")
    films = [episode(seed, frames=5) for seed in range(2)]
    poses = [{"cup": np.array([0, 0.1, 0, 0, 0, 0, 1.0])}] * 2
    save_bank(make_bank(films, poses, [np.zeros(14)] * 2), folder / "bank.npz")
    write_episode(films[0], folder / "film.hdf5")


def _training(folder: Path) -> None:
    """The folder of a finished training, with its checkpoint."""
    from embodiedreamer_gym.cli import main

    if main(["policy", "train", "--data", str(folder / "episodes"), "--out", str(folder / "training"), *TRAIN]):
        raise SystemExit("the seed of the resume checkpoints cannot be trained; see the error above.")
