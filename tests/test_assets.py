"""The built-in robots: sound URDFs, the published figures, and JSON that fits them."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet
import pytest
import yourdfpy
from pybullet_utils.bullet_client import BulletClient

import embodiedreamer_gym

ASSETS = Path(embodiedreamer_gym.__file__).parent / "assets"
ROBOTS = ["aloha", "so101", "servo"]
PIPER_LIMITS = np.array(  # degrees: AgileX piper_sdk
    [[-150, 150], [0, 180], [-170, 0], [-100, 100], [-70, 70], [-120, 120]]
)


def _path(name: str) -> Path:
    return ASSETS / "urdf" / f"{name}.urdf"


def _model(name: str) -> dict:
    return json.loads((ASSETS / f"{name}.json").read_text())


def _bullet(name: str) -> tuple[BulletClient, int, dict[str, int]]:
    client = BulletClient(pybullet.DIRECT)
    client.setGravity(0, 0, -9.81)
    body = client.loadURDF(str(_path(name)), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    ids = {client.getJointInfo(body, i)[1].decode(): i for i in range(client.getNumJoints(body))}
    return client, body, ids


def _gravity_torque(name: str, angles: dict[str, float]) -> dict[str, float]:
    """Torque in N m that holds each joint against gravity, from PyBullet."""
    client, body, ids = _bullet(name)
    movable = [joint for joint, i in ids.items() if client.getJointInfo(body, i)[3] >= 0]
    q = [angles.get(joint, 0.0) for joint in movable]
    torque = client.calculateInverseDynamics(body, q, [0.0] * len(q), [0.0] * len(q))
    client.disconnect()
    return dict(zip(movable, torque, strict=True))


@pytest.mark.parametrize("name", ROBOTS)
def test_masses_and_inertias_are_those_of_bodies(name: str) -> None:
    urdf = yourdfpy.URDF.load(str(_path(name)), load_meshes=False)
    for link in urdf.robot.links:
        assert link.inertial is not None, f"{link.name}: PyBullet would give it 1 kg"
        assert link.inertial.mass > 0
        moments = np.linalg.eigvalsh(link.inertial.inertia)
        assert moments[0] > 0, link.name
        assert moments[0] + moments[1] >= moments[2], link.name  # triangle inequality


@pytest.mark.parametrize("name", ROBOTS)
def test_pybullet_reads_the_same_masses(name: str) -> None:
    urdf = yourdfpy.URDF.load(str(_path(name)), load_meshes=False)
    client, body, ids = _bullet(name)
    for joint, i in ids.items():
        link = client.getJointInfo(body, i)[12].decode()
        assert urdf.joint_map[joint].child == link
        mass, _, inertia, *_ = client.getDynamicsInfo(body, i)
        wanted = urdf.link_map[link].inertial
        assert mass == pytest.approx(wanted.mass)
        assert sorted(inertia) == pytest.approx(np.linalg.eigvalsh(wanted.inertia), rel=1e-3)
    client.disconnect()


@pytest.mark.parametrize("name", ROBOTS)
def test_shapes_are_primitives(name: str) -> None:
    root = ElementTree.parse(_path(name)).getroot()
    assert not root.findall(".//mesh") and not root.findall(".//texture")
    assert all(entry[0].tag in ("box", "cylinder", "sphere") for entry in root.findall(".//geometry"))
    assert root.findall(".//collision")


@pytest.mark.parametrize("name", ROBOTS)
def test_the_json_fits_its_urdf(name: str) -> None:
    model, urdf = _model(name), yourdfpy.URDF.load(str(_path(name)), load_meshes=False)
    robot, joints = model["robot"], model["robot"]["joints"]
    assert (ASSETS / robot["urdf"]).samefile(_path(name))
    assert set(joints) <= set(urdf.joint_map) and len(set(joints)) == len(joints)
    assert all(urdf.joint_map[joint].mimic is None for joint in joints)
    free = {x.name for x in urdf.robot.joints if x.type != "fixed" and x.mimic is None}
    assert set(joints) == free
    assert set(robot["end_effectors"]) <= set(urdf.link_map)
    for joint, (at_zero, at_one) in robot.get("normalised", {}).items():
        limit = urdf.joint_map[joint].limit
        assert limit.lower == pytest.approx(at_zero) and limit.upper == pytest.approx(at_one)
    groups = [model["servo"]["stiffness"], model["servo"]["damping"]]
    for values in [*groups, model.get("rotor_inertia", groups[0])]:
        assert len(values) == len(joints) and min(values) > 0
    assert len(model["viscous_friction"]) == len(joints) and min(model["viscous_friction"]) >= 0
    assert model["effects"] == []


def test_aloha_has_the_order_of_aloha_recordings() -> None:
    arm = [*(f"joint{i}" for i in range(1, 7)), "gripper"]
    assert _model("aloha")["robot"]["joints"] == [f"{side}_{j}" for side in ("left", "right") for j in arm]


@pytest.mark.parametrize("side", ["left", "right"])
def test_aloha_has_the_makers_limits(side: str) -> None:
    urdf = yourdfpy.URDF.load(str(_path("aloha")), load_meshes=False)
    found = [urdf.joint_map[f"{side}_joint{i}"].limit for i in range(1, 7)]
    np.testing.assert_allclose([[x.lower, x.upper] for x in found], np.radians(PIPER_LIMITS), atol=1e-5)
    assert all(x.velocity == 3.0 for x in found)
    finger = urdf.joint_map[f"{side}_gripper"].limit
    assert (finger.lower, finger.upper) == (0.0, 0.035)


@pytest.mark.parametrize(("side", "y"), [("left", 0.3), ("right", -0.3)])
def test_aloha_stands_as_on_the_cobot_magic(side: str, y: float) -> None:
    urdf = yourdfpy.URDF.load(str(_path("aloha")), load_meshes=False)
    assert urdf.base_link == "footprint"
    np.testing.assert_allclose(urdf.get_transform(f"{side}_base")[:3, 3], [0.23875, y, 0.775])


@pytest.mark.parametrize("side", ["left", "right"])
def test_aloha_fingers_open_together_around_the_tip(side: str) -> None:
    urdf = yourdfpy.URDF.load(str(_path("aloha")), load_meshes=False)
    mimic = urdf.joint_map[f"{side}_finger2"].mimic
    assert (mimic.joint, mimic.multiplier, mimic.offset) == (f"{side}_gripper", 1.0, 0.0)
    for opening in (0.0, 0.035):
        urdf.update_cfg({f"{side}_gripper": opening})
        tip = urdf.get_transform(f"{side}_gripper_tip")[:3, 3]
        one = urdf.get_transform(f"{side}_finger1")[:3, 3]
        two = urdf.get_transform(f"{side}_finger2")[:3, 3]
        np.testing.assert_allclose((one + two) / 2, tip, atol=1e-8)
        assert np.linalg.norm(one - two) == pytest.approx(2 * opening, abs=1e-8)


@pytest.mark.parametrize("side", ["left", "right"])
def test_aloha_weighs_on_its_joints_as_published(side: str) -> None:
    """Gravity torque of the maker's masses at (0, 1.57, -1.35, 0, 0, 0): -5.5, -4.65, -0.87 N m."""
    torque = _gravity_torque("aloha", {f"{side}_joint2": 1.57, f"{side}_joint3": -1.35})
    for joint, wanted in {"joint2": -5.5, "joint3": -4.65, "joint5": -0.87}.items():
        assert torque[f"{side}_{joint}"] == pytest.approx(wanted, rel=0.15)


def test_so101_sinks_towards_positive_angles() -> None:
    """In the recordings' working pose all three pitching joints sag towards plus."""
    torque = _gravity_torque("so101", {"elbow_flex": 0.5})
    assert all(torque[joint] < 0 for joint in ("shoulder_lift", "elbow_flex", "wrist_flex"))


def test_servo_lever_falls_towards_negative_angles() -> None:
    """As the measured drops: it hangs straight down at -pi/2 - 0.35 rad."""
    assert _gravity_torque("servo", {})["servo"] > 0
    assert _gravity_torque("servo", {"servo": -np.pi / 2 - 0.35})["servo"] == pytest.approx(0.0, abs=1e-6)
    assert _gravity_torque("servo", {"servo": -0.35})["servo"] == pytest.approx(0.352 * 9.81 * 0.1, rel=1e-4)


def test_sources_name_every_asset_here() -> None:
    text = (ASSETS / "SOURCES.md").read_text()
    for name in ROBOTS:
        assert f"{name}.urdf" in text and f"{name}.json" in text
