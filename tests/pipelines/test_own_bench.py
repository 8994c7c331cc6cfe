"""The whole way of "your own bench" on a robot that is not built in, before a camera that was pushed once."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import gymnasium as gym
import numpy as np
import pytest

from embodiedreamer_gym.cli.command import main
from embodiedreamer_gym.engines.robot_view import RobotView
from embodiedreamer_gym.envs.cameras import load_cameras, look_at, save_cameras
from embodiedreamer_gym.geometry.camera import Camera
from embodiedreamer_gym.recordings import Recording, save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.carved_urdf import add_visual
from embodiedreamer_gym.vis_aligner import load_bank, load_episode
from embodiedreamer_gym.wrappers import VisAlignerObservationWrapper

pybullet_data = pytest.importorskip("pybullet_data", reason="the extra [bullet] is not installed")
PANDA = Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"
JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))
SIZE, ROWS = (128, 96), 30
PLACES = {"one": (1.35, 0.5, 0.9), "pushed": (1.37, 0.46, 0.92)}  # recording -> camera, m
TOOL = np.array([[-0.03, 0.02, 0.03], [0.03, 0.16, 0.15]])  # corners of what is on the hand and not in the URDF, m


def camera(recording: str) -> Camera:
    """Where the camera really stands."""
    turned = look_at(PLACES[recording], (0.3, 0.0, 0.4))
    return Camera("top", PLACES[recording], turned, SIZE, 120.0, 120.0, 63.5, 47.5)


def motion(seed: int) -> np.ndarray:
    """Joint angles (T, 7), rad, of a slow wandering."""
    rng, time = np.random.default_rng(seed), np.linspace(0.0, 1.0, ROWS)[:, None]
    waves = sum(np.sin(2 * np.pi * (k * time + rng.random(7))) * rng.uniform(0.4, 0.7, 7) for k in (1, 2))
    reach = np.array([0.6, 0.3, 0.5, 0.4, 0.6, 0.4, 0.9])
    return np.array([0.0, 0.1, 0.0, -1.9, 0.0, 2.0, 0.8]) + reach * waves


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings with video of a Panda that holds a tool, and a camera file with a first guess."""
    folder = tmp_path_factory.mktemp("bench")
    corners = np.stack(np.meshgrid(*TOOL.T, indexing="ij"), -1).reshape(-1, 3)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([(s[i], s[j], s[k]) for s in sides for i, j, k in ((0, 1, 2), (0, 2, 3))])
    add_visual(PANDA, "panda_hand", corners, faces, (0.8, 0.1, 0.1), folder / "true.urdf")
    model, rng = RobotModel.of_urdf(folder / "true.urdf", JOINTS), np.random.default_rng(5)
    background = cv2.resize(rng.integers(90, 200, (6, 8, 3)).astype(np.uint8), SIZE, interpolation=cv2.INTER_CUBIC)
    for number, name in enumerate(PLACES):
        angles = motion(number)
        with RobotView(model, camera(name), SIZE) as view:
            seen = [view.at(row) for row in angles]
        frames = [np.where(s.segmentation[..., None] == 2, s.rgb * 0.8, background) for s in seen]
        noisy = [np.clip(f + rng.normal(0, 2, f.shape), 0, 255).astype(np.uint8) for f in frames]
        log = Recording(name, JOINTS, np.arange(ROWS) / 10, angles, angles, frames={"top": np.stack(noisy)})
        save_recording(log, folder / f"{name}.hdf5")
    guess = camera("one").with_(position=tuple(np.add(PLACES["one"], 0.01)))
    save_cameras([guess], folder / "guess.json")
    return folder


def overlap(bench: Path, folder: Path) -> float:
    """Intersection over union of the simulated robot with the real one, over all recordings."""
    both, either = 0, 0
    for number, name in enumerate(PLACES):
        shown = load_episode(folder / f"{name}.hdf5").condition.classes == 2
        with RobotView(RobotModel.of_urdf(bench / "true.urdf", JOINTS), camera(name), SIZE) as view:
            real = np.stack([view.at(row).segmentation == 2 for row in motion(number)])
        both, either = both + (shown & real).sum(), either + (shown | real).sum()
    return float(both / either)


class PandaEnv(gym.Env):
    """A Panda that goes where it is told."""

    obs_type, image_size = "pixels", SIZE

    def __init__(self, model: str, where: Camera) -> None:
        self.action_space = gym.spaces.Box(-3.0, 3.0, (7,), np.float32)
        self.observation_space = gym.spaces.Box(0, 255, (SIZE[1], SIZE[0], 3), np.uint8)
        self._view, self._joints = RobotView(RobotModel.load(model), where, SIZE), motion(1)[0]

    def capture(self, camera: str, size: tuple[int, int]):
        return self._view.at(self._joints)

    def reset(self, *, seed: int | None = None, options=None):
        self._joints = motion(1)[0]
        return self.capture("head", SIZE).rgb, {}

    def step(self, action):
        self._joints = np.asarray(action, float)
        return self.capture("head", SIZE).rgb, 0.0, False, False, {}

    def close(self) -> None:
        self._view.close()


@pytest.mark.slow
def test_every_step_takes_what_the_one_before_wrote(bench: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    logs = [str(bench / f"{name}.hdf5") for name in PLACES]
    urdf = ["--model", str(PANDA), "--joints", ",".join(JOINTS)]

    def run(*arguments: str) -> str:
        capsys.readouterr()
        assert main([*arguments, "--quiet"]) == 0, capsys.readouterr().err
        return capsys.readouterr().out

    run(
        "vis",
        "camera",
        *logs,
        *urdf,
        "--start",
        str(bench / "guess.json"),
        "--loose",
        "panda_hand",
        "--out",
        "cameras.json",
    )
    found = load_cameras("cameras.json")
    assert set(found) == {"top/one", "top/pushed"}
    for name in PLACES:
        assert np.linalg.norm(np.subtract(found[f"top/{name}"].position, PLACES[name])) < 0.03

    run("vis", "carve", *logs, *urdf, "--cameras", "cameras.json", "--link", "panda_hand", "--out", "panda.json")
    assert sorted(p.name for p in tmp_path.glob("panda*")) == [
        "panda.json",
        "panda_carved.urdf",
        "panda_carved_panda_hand.obj",
    ]
    robot = ["--model", "panda.json", "--cameras", "cameras.json"]
    run("vis", "prepare", *logs, *urdf, "--cameras", "cameras.json", "--size", "128x96", "--out", "bare")
    run("vis", "prepare", *logs, *robot, "--size", "128x96", "--out", "episodes")
    assert overlap(bench, tmp_path / "episodes") > max(0.85, overlap(bench, tmp_path / "bare") + 0.03)

    one, pushed = (load_episode(tmp_path / "episodes" / f"{name}.hdf5").appearance for name in PLACES)
    assert one != pushed and one.startswith("top/") and pushed.startswith("top/")
    assert main(["vis", "bank", "episodes", "--out", "all.npz", "--quiet"]) == 2
    assert "one bench from two camera places" in capsys.readouterr().err
    run("vis", "bank", "episodes/one.hdf5", "--more", "episodes/pushed.hdf5", "--out", "bank.npz")
    gallery = load_bank(tmp_path / "bank.npz").bench.gallery  # pyright: ignore[reportOptionalMemberAccess]
    assert gallery is not None and len(gallery) == 40

    run("vis", "fine-tune", "episodes/one.hdf5", "episodes/pushed.hdf5", "--steps", "2", "--out", "mine")
    out = run("vis", "evaluate", "episodes/one.hdf5", "--aligner", "mine/lean.pt", "--bank", "bank.npz", "--chunks", "2",
              "--strips", "strips", "--json", "m.json")  # fmt: skip
    assert "closed loop" in out and (tmp_path / "strips" / "one.png").exists()
    measures = json.loads((tmp_path / "m.json").read_text())["episodes"][0]["measures"]
    psnr = {name: row["values"]["psnr"] for name, row in measures.items()}
    assert psnr["after true frames"] > psnr["raw simulation"] + 5

    env = VisAlignerObservationWrapper(PandaEnv("panda.json", found["top/one"]), "mine/lean.pt", "bank.npz")
    observation, _ = env.reset(seed=0)
    _, _, _, _, info = env.step(motion(0)[:8].astype(np.float32))
    assert observation.shape == (96, 128, 3) and info["frames"].shape == (8, 96, 128, 3)
    assert (info["frames"][-1] != observation).any()
    env.close()
