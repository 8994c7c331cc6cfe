"""The tree's kinematics and dynamics against PyBullet and yourdfpy."""

from __future__ import annotations

import numpy as np
import pybullet
import pytest
import yourdfpy
from pybullet_utils.bullet_client import BulletClient

from embodiedreamer_gym.robot import RobotModel
from tests.bank import BUILT_IN, energy, load, poses, robot


def samples(model: RobotModel, count: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    low = np.where(np.isfinite(model.tree.lower), model.tree.lower, -2.0)
    high = np.where(np.isfinite(model.tree.upper), model.tree.upper, 2.0)
    q = low + (high - low) * rng.random((count, model.n))
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


def check_against_bullet(model: RobotModel) -> None:
    """Mass matrix and torques per driven coordinate; PyBullet's are per URDF joint."""
    tree, client = model.tree, BulletClient(pybullet.DIRECT)
    try:
        client.setGravity(0, 0, -9.81)
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        body = client.loadURDF(str(model.urdf), useFixedBase=True, flags=flags)
        infos = [client.getJointInfo(body, j) for j in range(client.getNumJoints(body))]
        movable = [info for info in infos if info[2] != pybullet.JOINT_FIXED]
        place = {info[1].decode(): k for k, info in enumerate(movable)}
        to_joints = np.zeros((len(movable), model.n))
        offset = np.zeros(len(movable))
        for name, c, gain, shift in zip(tree.joint_names, tree.coordinate, tree.gain, tree.offset, strict=True):
            to_joints[place[name], c], offset[place[name]] = gain, shift
        q, v, a = samples(model)
        matrix, bias = model.bodies.mass_matrix_and_bias(q, v, model.nominal_mechanics)
        torque, force = model.bodies.inverse_dynamics(q, v, a, model.nominal_mechanics)
        for k in range(len(q)):
            x = [to_joints @ y for y in (q[k], v[k], a[k])]
            x[0] = x[0] + offset
            theirs = np.array(client.calculateInverseDynamics(body, *(y.tolist() for y in x)))
            np.testing.assert_allclose(torque[k], to_joints.T @ theirs, rtol=1e-6, atol=1e-7)
            per_joint = [theirs[place[name]] for name in tree.joint_names]
            np.testing.assert_allclose(force[k], per_joint, rtol=1e-6, atol=1e-7)
            at_rest = np.array(
                client.calculateInverseDynamics(body, x[0].tolist(), x[1].tolist(), [0.0] * len(movable))
            )
            np.testing.assert_allclose(bias[k], to_joints.T @ at_rest, rtol=1e-6, atol=1e-7)
            mass = np.array(client.calculateMassMatrix(body, x[0].tolist()))
            np.testing.assert_allclose(matrix[k], to_joints.T @ mass @ to_joints, rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(torque[k], matrix[k] @ a[k] + bias[k], rtol=1e-9, atol=1e-9)
    finally:
        client.disconnect()


def check_against_yourdfpy(model: RobotModel) -> None:
    """Every moving body's joint frame, and the end effectors."""
    tree = model.tree
    urdf = yourdfpy.URDF.load(str(model.urdf), load_meshes=False, build_scene_graph=True)
    children = {joint.name: joint.child for joint in urdf.robot.joints}
    for q in samples(model, 3)[0]:
        value = {name: 0.0 for name in urdf.actuated_joint_names}
        for name, c, gain, shift in zip(tree.joint_names, tree.coordinate, tree.gain, tree.offset, strict=True):
            if name in value:
                value[name] = gain * q[c] + shift
        urdf.update_cfg(value)
        rotation, origin = poses(model, q)
        for i, name in enumerate(tree.joint_names):
            theirs = urdf.get_transform(children[name])
            np.testing.assert_allclose(rotation[i], theirs[:3, :3], atol=1e-9)
            np.testing.assert_allclose(origin[i], theirs[:3, 3], atol=1e-9)
        for link, (body, turn, point) in tree.tips.items():
            theirs = urdf.get_transform(link)
            np.testing.assert_allclose(origin[body] + rotation[body] @ point, theirs[:3, 3], atol=1e-9)
            np.testing.assert_allclose(rotation[body] @ turn, theirs[:3, :3], atol=1e-9)


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_built_in_robot_moves_as_in_pybullet_and_yourdfpy(name: str) -> None:
    check_against_bullet(robot(name))
    check_against_yourdfpy(robot(name))


@pytest.mark.parametrize("seed", range(6))
def test_a_random_robot_moves_as_in_pybullet_and_yourdfpy(seed: int, random_urdf) -> None:
    urdf, joints = random_urdf(seed)
    model = load({"robot": {"urdf": "random.urdf", "joints": joints}}, urdf, "random")
    check_against_bullet(model)
    check_against_yourdfpy(model)


def test_bias_is_the_slope_of_the_energy() -> None:
    """At rest the bias is the gradient of the potential, so signs do not rest on another library alone."""
    model, step = robot("arm6"), 1e-6
    q = np.array([0.3, -0.5, 0.9, 0.4, 0.3, 0.2])
    _, bias = model.bodies.mass_matrix_and_bias(q[None], np.zeros((1, 6)), model.nominal_mechanics)
    rest = np.zeros(6)
    slope = [(energy(model, q + step * e, rest) - energy(model, q - step * e, rest)) / (2 * step) for e in np.eye(6)]
    np.testing.assert_allclose(bias[0], slope, atol=1e-6)


def test_two_arms_are_two_branches() -> None:
    tree = robot("aloha").tree
    assert tree.arms == 2 and list(tree.arm) == [0] * 7 + [1] * 7
    assert list(tree.tips) == ["left_gripper_tip", "right_gripper_tip"]
    assert repr(tree) == f"KinematicTree({tree.bodies} bodies, 14 driven joints, 2 arms)"


def test_a_normalised_gripper_runs_from_0_to_1() -> None:
    model = robot("aloha")
    grip = model.joints.index("left_gripper")
    own = model.tree.coordinate == grip
    assert model.units[grip] == "1" and (model.tree.lower[grip], model.tree.upper[grip]) == (0.0, 1.0)
    assert own.sum() == 2, "the mimic finger moves too"
    np.testing.assert_allclose(np.abs(model.tree.gain[own]), 0.035)
    np.testing.assert_allclose(model.tree.offset[own], 0.0)


def test_a_normalised_joint_that_mimics_has_its_multiplier(random_urdf) -> None:
    urdf, joints = random_urdf(0)
    data = {"robot": {"urdf": "r.urdf", "joints": joints, "normalised": {joints[0]: [0.5, 1.5]}}}
    tree = load(data, urdf, "r").tree
    follower = [i for i, name in enumerate(tree.joint_names) if name not in joints]
    assert len(follower) == 1
    assert tree.gain[follower[0]] == pytest.approx(-0.6)
    assert tree.offset[follower[0]] == pytest.approx(-0.6 * 0.5 + 0.1)


def test_joints_that_are_not_driven_stay_at_zero(random_urdf) -> None:
    urdf, joints = random_urdf(3)
    whole = load({"robot": {"urdf": "r.urdf", "joints": joints}}, urdf, "r")
    fewer = load({"robot": {"urdf": "r.urdf", "joints": joints[:3]}}, urdf, "r")
    q = np.zeros((1, whole.n))
    q[0, :3] = 0.3, -0.2, 0.4
    all_bodies = whole.bodies.mass_matrix_and_bias(q, 0 * q, whole.nominal_mechanics)
    few_bodies = fewer.bodies.mass_matrix_and_bias(q[:, :3], 0 * q[:, :3], fewer.nominal_mechanics)
    if all(n in joints for n in whole.tree.joint_names):  # a mimic that follows an undriven joint would differ
        np.testing.assert_allclose(few_bodies[0][0], all_bodies[0][0, :3, :3], rtol=1e-9)
        np.testing.assert_allclose(few_bodies[1][0], all_bodies[1][0, :3], rtol=1e-9)
