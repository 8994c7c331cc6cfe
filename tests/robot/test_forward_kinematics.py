"""Forward kinematics against two other computations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yourdfpy

import embodiedreamer_gym
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.forward_kinematics import EndEffector

ASSETS = Path(embodiedreamer_gym.__file__).parent / "assets"
# AgileX piper_sdk, kinematics/piper_fk.py, firmware from S-V1.6-3 on: modified DH, m and rad.
PIPER_A = [0.0, 0.0, 0.28503, -0.02198, 0.0, 0.0]
PIPER_ALPHA = np.radians([0, -90, 0, 90, -90, 90])
PIPER_D = [0.123, 0.0, 0.0, 0.25075, 0.0, 0.091]
PIPER_THETA = np.radians([0, -172.22, -102.78, 0, 0, 0])


def _random_values(urdf: yourdfpy.URDF, joints: tuple[str, ...], count: int = 20) -> np.ndarray:
    limits = [urdf.joint_map[name].limit for name in joints]
    low, high = np.array([x.lower for x in limits]), np.array([x.upper for x in limits])
    return np.random.default_rng(3).uniform(low, high, (count, len(joints)))


@pytest.mark.parametrize("name", ["aloha", "so101", "servo"])
def test_forward_kinematics_agree_with_yourdfpy(name: str) -> None:
    path = ASSETS / "urdf" / f"{name}.urdf"
    joints = tuple(json.loads((ASSETS / f"{name}.json").read_text())["robot"]["joints"])
    urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
    values = _random_values(urdf, joints)
    for link in urdf.link_map:
        position, rotation = EndEffector(path, link).pose(values, joints)
        assert position.dtype == rotation.dtype == np.float64
        for row, x, r in zip(values, position, rotation, strict=True):
            urdf.update_cfg(dict(zip(joints, row, strict=True)))
            wanted = urdf.get_transform(link)
            np.testing.assert_allclose(x, wanted[:3, 3], rtol=0, atol=1e-12)
            np.testing.assert_allclose(r, wanted[:3, :3], rtol=0, atol=1e-12)


def test_aloha_agrees_with_the_makers_denavit_hartenberg_table() -> None:
    urdf = yourdfpy.URDF.load(str(ASSETS / "urdf" / "aloha.urdf"), load_meshes=False)
    joints = tuple(f"left_joint{i}" for i in range(1, 7))
    values = _random_values(urdf, joints, 200)
    base, _ = EndEffector(ASSETS / "urdf" / "aloha.urdf", "left_base").pose(values, joints)
    position, _ = EndEffector(ASSETS / "urdf" / "aloha.urdf", "left_link6").pose(values, joints)
    wanted = np.array([_piper_wrist(row) for row in values])
    assert np.linalg.norm(position - base - wanted, axis=1).max() <= 0.2e-3


def _piper_wrist(values: np.ndarray) -> np.ndarray:
    place = np.eye(4)
    for a, alpha, d, theta in zip(PIPER_A, PIPER_ALPHA, PIPER_D, PIPER_THETA + values, strict=True):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        place = place @ np.array(
            [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
        )
    return place[:3, 3]


def test_text_and_path_are_the_same_and_other_joints_are_ignored() -> None:
    path = ASSETS / "urdf" / "servo.urdf"
    values = np.array([[0.0], [0.4]])
    from_path = EndEffector(path, "lever_tip").pose(values, ["servo"])
    more = np.column_stack([[9.0, 9.0], values])
    from_text = EndEffector(path.read_text(), "lever_tip").pose(more, ["other", "servo"])
    np.testing.assert_array_equal(from_path[0], from_text[0])
    np.testing.assert_array_equal(from_path[1], from_text[1])


def test_what_is_missing_is_named() -> None:
    path = ASSETS / "urdf" / "servo.urdf"
    with pytest.raises(ModelError, match="no link 'hand'; links: base, lever, lever_tip"):
        EndEffector(path, "hand")
    with pytest.raises(ModelError, match="does not exist"):
        EndEffector("nowhere.urdf", "lever")
    with pytest.raises(ModelError, match="is not XML"):
        EndEffector("<robot>", "lever")
    tip = EndEffector(path, "lever_tip")
    with pytest.raises(ModelError, match=r"'servo' of .* moves 'lever_tip' but has no values; given are other"):
        tip.pose(np.zeros((3, 1)), ["other"])
    with pytest.raises(ModelError, match=r"need \(T, 1\)"):
        tip.pose(np.zeros(3), ["servo"])
