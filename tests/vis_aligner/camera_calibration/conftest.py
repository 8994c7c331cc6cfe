"""The left arm of the ALOHA bench before a camera whose truth is known, drawn by PyBullet's own renderer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.engines.bullet.rendering import Renderer
from embodiedreamer_gym.geometry.camera import Camera, look_at
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.surface import Surface
from embodiedreamer_gym.vis_aligner.camera_calibration import Footage, Keypoints, View

SIZE = (240, 180)
ROWS = 30
CENTRE = (0.55, 0.3, 0.95)  # m: where the left arm works
TRUTH = Camera("truth", (1.25, 0.95, 1.45), look_at((1.25, 0.95, 1.45), CENTRE), SIZE, 205.0, 205.0, 119.5, 89.5)


@lru_cache
def surface() -> Surface:
    return Surface.of_model(RobotModel.load("aloha"))


def motion(seed: int = 0, rows: int = ROWS) -> np.ndarray:
    """Joint angles (T, 14): the left arm wanders slowly, the right one rests."""
    rng = np.random.default_rng(seed)
    middle, reach = np.array([0.0, 1.2, -1.2, 0.0, 0.3, 0.0]), np.array([0.8, 0.5, 0.5, 0.6, 0.5, 0.6])
    time = np.linspace(0.0, 1.0, rows)[:, None]
    waves = sum(np.sin(2 * np.pi * (k * time + rng.random(6))) * rng.uniform(0.3, 0.7, 6) for k in (1, 2))
    angles = np.zeros((rows, 14))
    angles[:, :6] = middle + reach * waves
    angles[:, 6] = 0.5
    return angles


def paint(size: tuple[int, int]) -> np.ndarray:
    """A background (H, W, 3), uint8, with edges and colours."""
    rng = np.random.default_rng(5)
    coarse = rng.integers(60, 200, (6, 8, 3)).astype(np.uint8)
    return cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)


def film(camera: Camera, angles: np.ndarray, noise: float = 2.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Frames (T, H, W, 3), uint8, and masks (T, H, W), bool, of the robot at joint angles (T, 14)."""
    model = RobotModel.load("aloha")
    client = BulletClient(pybullet.DIRECT)
    renderer = Renderer(client, "tiny", camera.size)
    robot = client.loadURDF(str(model.urdf), useFixedBase=True)
    count = client.getNumJoints(robot)
    number = {client.getJointInfo(robot, j)[1].decode(): j for j in range(count)}
    background, rng = paint(camera.size), np.random.default_rng(seed)
    frames, masks = [], []
    for row in angles:
        for name, value in zip(model.joints, row, strict=True):
            value = value * 0.035 if "gripper" in name else value
            client.resetJointState(robot, number[name], value)
            if "gripper" in name:
                client.resetJointState(robot, number[name.replace("gripper", "finger2")], value)
        seen = renderer.capture(camera, camera.size, classes={robot: 1})
        picture = np.where(seen.segmentation[..., None] > 0, seen.rgb, background).astype(float)
        frames.append(np.clip(picture + rng.normal(0.0, noise, picture.shape), 0, 255).astype(np.uint8))
        masks.append(seen.segmentation > 0)
    renderer.close()
    client.disconnect()
    return np.stack(frames), np.stack(masks)


def marks_of(camera: Camera, angles: np.ndarray, count: int = 12, sd: float = 0.0, seed: int = 0) -> Keypoints:
    """Points of the moving arm and where a camera sees them, with an error of the marking hand."""
    rng = np.random.default_rng(seed)
    points = surface().points(angles)
    arm = np.flatnonzero(np.ptp(points, axis=0).max(axis=1) > 0.1)
    point = points[rng.integers(len(points), size=count), rng.choice(arm, count)].astype(float)
    pixel = View.from_camera(camera).project(point)[:, :2] + rng.normal(0.0, sd, (count, 2))
    return Keypoints(np.zeros(count), point, pixel, np.full(count, max(sd, 0.5)))


def apart(camera: Camera, truth: Camera, angles: np.ndarray) -> float:
    """Median distance, pixels, between where two cameras see the robot's points."""
    points = surface().points(angles)[:, ::7].reshape(-1, 3)
    first, second = (View.from_camera(c).project(points) for c in (camera, truth))
    width, height = truth.size
    inside = (second[:, 0] > 0) & (second[:, 0] < width) & (second[:, 1] > 0) & (second[:, 1] < height)
    return float(np.median(np.linalg.norm(first[inside, :2] - second[inside, :2], axis=1)))


@dataclass(frozen=True)
class Bench:
    """A recording before the true camera."""

    angles: np.ndarray
    frames: np.ndarray
    masks: np.ndarray

    def footage(self, **changes: object) -> Footage:
        given = {"frames": self.frames, "poses": surface().poses(self.angles), "name": "bench"} | changes
        return Footage(**given)  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="session")
def bench() -> Bench:
    angles = motion()
    return Bench(angles, *film(TRUTH, angles))


@pytest.fixture(scope="session")
def near() -> Camera:
    """A first guess beside the truth: 10 cm and 4 degrees off, with another focal length."""
    position = np.add(TRUTH.position, (0.07, -0.05, 0.05))
    aim = np.add(CENTRE, (0.06, -0.05, 0.06)).tolist()
    return TRUTH.with_(position=tuple(position), rotation=look_at(position.tolist(), aim), fx=225.0, fy=225.0)
