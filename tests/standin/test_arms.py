import xml.etree.ElementTree as ElementTree

import numpy as np
import pybullet
import pytest

from embodiedreamer_gym.errors import MissingExtraError, ModelError
from embodiedreamer_gym.standin.arms import ARMS, TRUTH, arm_home, arm_joints, arm_urdf
from embodiedreamer_gym.standin.plant import import_mujoco


@pytest.mark.parametrize("arm", ARMS)
def test_servo_home_and_joints_fit_together(arm):
    n = len(arm_joints(arm))
    servo = TRUTH[arm]
    for values in (
        servo.stiffness,
        servo.damping,
        servo.rotor_inertia,
        servo.viscous_friction,
        arm_home(arm),
    ):
        assert len(values) == n
    limits = [joint.find("limit") for joint in ElementTree.fromstring(arm_urdf(arm)).iter("joint")][:n]
    for home, limit in zip(arm_home(arm), limits, strict=True):
        assert float(limit.get("lower")) < home < float(limit.get("upper"))


@pytest.mark.parametrize("arm", ARMS)
def test_every_link_has_a_mass_and_only_primitive_shapes(arm):
    root = ElementTree.fromstring(arm_urdf(arm))
    assert root.get("name") == arm
    assert all(link.find("inertial/mass") is not None for link in root.iter("link"))
    assert {shape.tag for geometry in root.iter("geometry") for shape in geometry} == {"box"}


@pytest.mark.parametrize(("arm", "mass"), [("arm6", 4.1), ("arm6b", 5.9), ("arm7", 8.6)])
def test_moving_mass(build, arm, mass):
    assert build(arm).moving_mass == pytest.approx(mass, abs=1e-4)


def test_the_other_engine_reads_the_same_mass(tmp_path):
    path = tmp_path / "arm6.urdf"
    path.write_text(arm_urdf("arm6"))
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        links = range(pybullet.getNumJoints(body, physicsClientId=client))
        masses = [pybullet.getDynamicsInfo(body, link, physicsClientId=client)[0] for link in links]
    finally:
        pybullet.disconnect(client)
    assert np.sum(masses) == pytest.approx(4.1, abs=1e-4)


def test_arms_differ_in_geometry():
    assert arm_urdf("arm6") != arm_urdf("arm6b")
    assert arm_urdf("arm6") == arm_urdf("arm6")


def test_an_unknown_arm_is_refused():
    with pytest.raises(ModelError, match="no stand-in arm 'arm9'; give one of arm6"):
        arm_urdf("arm9")


def test_without_mujoco_the_line_to_install_it_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match="pip install 'mujoco"):
        import_mujoco()
