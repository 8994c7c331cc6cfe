"""Valid, minimal files of every kind that users provide, written by the package's own writers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

SIZE = (16, 12)  # width and height of pictures, pixels
STEPS = 6  # steps of an episode
HOSE_SPRING = """from embodiedreamer_gym.effects import Parameter, SignalLaw


class HoseSpring(SignalLaw):
    name = "hose_spring"
    stage = "load"
    parameters = (Parameter("stiffness", "N m/rad^3", off=0.0, low=0.0, high=2.0, typical=0.1, scale="torque"),)
    symptom = "the error grows out of proportion with the bend of the joint"
    reveals = "a slow sweep of one joint through its range"
    confused_with = ("joint_spring",)

    @staticmethod
    def law(signal, joint, memory, p):
        return signal - p.stiffness * joint.position**3, memory
"""
TRAIN = ("--steps", "2", "--batch", "2", "--chunk", "4", "--size", "16x12", "--quiet")


def write_seeds(folder: Path) -> None:
    """Write all seeds into a folder; always with the same bytes."""
    for write in (
        _recordings,
        _sage,
        _other_logs,
        _episodes,
        _lerobot_set,
        _policies,
        _key_poses,
        _vision,
        _svd,
        _training,
        _bench,
    ):
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
    for name in ("log.csv", "test.csv"):
        save_recording(log, folder / name)
    frames = {"head": list(_pictures(len(log.time)))}
    save_recording(log.with_(frames=frames), folder / "log.hdf5")
    save_cameras(CAMERAS, folder / "cameras.json")
    rows = [f"{t:.2f},{0.2 * np.sin(t):.4f},{0.1 * t:.4f}" for t in np.arange(0, 1, 0.02)]
    (folder / "commands.csv").write_text("\n".join(["time,shoulder.command,elbow.command", *rows]) + "\n")
    mark = {"recording": "log", "frame": 0, "link": "upper", "point": [0.1, 0.0, 0.0], "pixel": [5.0, 6.0], "sd": 1.0}
    (folder / "marks.json").write_text(json.dumps({"marks": [{**mark, "frame": k} for k in range(3)]}))
    (folder / "hose_spring.py").write_text(HOSE_SPRING)


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


def _key_poses(folder: Path) -> None:
    """A policy of two key poses in the frame of a cup, which it detects in the whole picture, and pairs of rollouts."""
    import torch

    from embodiedreamer_gym.envs.cameras import CAMERAS
    from embodiedreamer_gym.policies.act.object_pose_head import ObjectPoseHead
    from embodiedreamer_gym.policies.key_pose.looking import Looker
    from embodiedreamer_gym.policies.key_pose.policy import KeyPosePolicy
    from embodiedreamer_gym.policies.key_pose.skill import Key, Skill
    from embodiedreamer_gym.policies.key_pose.training import save_key_poses
    from embodiedreamer_gym.policies.preferences import PreferenceSet, Trajectory
    from embodiedreamer_gym.robot import RobotModel

    torch.manual_seed(0)
    turns, posture = np.tile(np.diag([1.0, -1.0, -1.0]), (3, 1, 1)), np.array([0.0, 1.2, -1.0, 0.0, 0.5, 0.0])
    keys = tuple(
        Key("cup", np.tile([0.0, 0.0, z], (3, 1)), turns, event, 0.0, 0.1, 0.1, 0.2, 0.001, posture)
        for z, event in ((0.88, False), (0.8, True))
    )
    skill = Skill(keys, ({"cup": (0.5, 0.2, 0.0)},) * 3, "cup", 1.0)
    head = ObjectPoseHead(1)
    head.layers[-1].bias.data[:] = torch.tensor([0.0, 9.0])  # the whole picture is classified as cup
    looker = Looker(head, ("cup",), CAMERAS["head"], {"cup": 0.8}, {"cup": (0.0, 0.0, 1.0, 1.0)})
    policy = KeyPosePolicy(skill, RobotModel.load("aloha"), looker, 30.0, ("head",), SIZE)
    save_key_poses(policy, looker, "aloha", folder / "key_poses")

    def rollout(distance: float, attempt: int) -> Trajectory:
        seen, actions = {"agent_pos": np.zeros((2, 14), np.float32)}, np.full((2, 4, 14), distance, np.float32)
        outcome = {"distance": distance, "is_success": 0.0}
        return Trajectory(seen, actions, actions, np.full(2, 4), 0, attempt, outcome)

    PreferenceSet.choose([rollout(0.1, 0), rollout(0.3, 1)]).save(folder / "pairs.hdf5")


def _vision(folder: Path) -> None:
    """An episode with its simulated view, reference banks without and with light, and weights of a tiny video model."""
    import torch

    from embodiedreamer_gym.pipelines.prepare import write_episode
    from embodiedreamer_gym.vis_aligner import make_bank, save_bank
    from embodiedreamer_gym.vis_aligner.checkpoint import save_lean
    from embodiedreamer_gym.vis_aligner.lean import Lean, LeanConfig
    from tests.vis_aligner import lamps
    from tests.vis_aligner.scenes import episode

    torch.manual_seed(0)
    save_lean(Lean(LeanConfig((8, 8, 8, 16))), 3, folder / "lean.pt")
    films = [episode(seed, frames=5) for seed in range(2)]
    poses = [{"cup": np.array([0, 0.1, 0, 0, 0, 0, 1.0])}] * 2
    save_bank(make_bank(films, poses, [np.zeros(14)] * 2), folder / "bank.npz")
    write_episode(films[0], folder / "film.hdf5")
    shaded = [lamps.filmed(3, seed) for seed in range(2)]
    lit = make_bank(shaded)
    save_bank(replace(lit, bench=replace(lit.bench, light=lamps.lamps())), folder / "lit_bank.npz")
    write_episode(shaded[0], folder / "shaded.hdf5")


def _svd(folder: Path) -> None:
    """A folder with a tiny Stable Video Diffusion model, if diffusers is installed."""
    from importlib.util import find_spec

    if find_spec("diffusers"):
        from embodiedreamer_gym.vis_aligner.svd import save_svd
        from tests.vis_aligner.tiny_svd import tiny_svd

        save_svd(tiny_svd(chunk=3), folder / "svd")


def _training(folder: Path) -> None:
    """The folder of a finished training, with its checkpoint."""
    from embodiedreamer_gym.cli import main

    if main(["policy", "train", "--data", str(folder / "episodes"), "--out", str(folder / "training"), *TRAIN]):
        raise SystemExit("the seed of the resume checkpoints cannot be trained; see the error above.")


def _bench(folder: Path) -> None:
    """Two cases of the benchmark, their ground truth, and answers with predictions."""
    from embodiedreamer_gym.bench.cases import make_cases
    from embodiedreamer_gym.bench.run import run_entries

    make_cases(folder / "cases", folder / "truth", 2, 2, ("none", "single"), ("position",), seconds=1.0)
    (folder / "answers").mkdir()
    run_entries(["coulomb"], folder / "cases", folder / "answers" / "a.jsonl")
