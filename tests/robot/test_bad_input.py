"""Whatever is wrong with a model's file or its URDF is said in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from embodiedreamer_gym.errors import EffectError, EmbodieDreamerError, ModelError
from embodiedreamer_gym.robot import RobotModel
from tests.two_joint_arm import write_arm

FORE = '<child link="fore"/>'
ELBOW = '<axis xyz="0 1 0"/>'
PAYLOAD, COULOMB = {"name": "payload"}, {"name": "coulomb_friction"}


def refused(folder: Path, words: str, error: type[EmbodieDreamerError] = ModelError) -> None:
    with pytest.raises(error, match=words) as caught:
        RobotModel.load(folder / "bad.json")
    text = str(caught.value)
    assert "\n" not in text and text.endswith(".") and len(text) < 800


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    write_arm(tmp_path, "bad")
    return tmp_path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("</robot>", "", "cannot be read"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0">', "cannot be read"),
        ("<robot name", "<machine name", "cannot be read"),
        (FORE, '<child link="nowhere"/>', "joint 'elbow' names the child link 'nowhere'"),
        ('<parent link="upper"/>', '<parent link="nowhere"/>', "names the parent link 'nowhere'"),
        ('mass value="0.6"', 'mass value="0"', "moved by joint 'elbow' have mass 0"),
        ('mass value="0.6"', 'mass value="-1"', "moved by joint 'elbow' have mass -1"),
        ('mass value="0.6"', 'mass value="nan"', "inertial of link 'fore' is not finite"),
        ('mass value="0.6"', 'mass value="heavy"', "cannot be read"),
        ('izz="0.003"', 'izz="-0.5"', "an inertia that no body can have"),
        ('izz="0.003"', 'izz="inf"', "inertial of link 'fore' is not finite"),
        (ELBOW, '<axis xyz="0 0 0"/>', "an axis of length zero"),
        ('xyz="0.25 0 0"', 'xyz="0.25 nan 0"', "origin of joint 'elbow' is not finite"),
        ('xyz="0.25 0 0"', 'xyz="2e9 0 0"', "origin of joint 'elbow' is 2e\\+09 m away; at most 10000 m"),
        ('<link name="base"/>', '<link name="base"/><link name="island"/>', "one root link, but has 2"),
        ('<link name="base"/>', '<link name="base"/><link name="fore"/>', "two links named 'fore'"),
        ('joint name="elbow"', 'joint name="shoulder"', "two joints named 'shoulder'"),
        ('<parent link="base"/>', '<parent link="fore"/>', "one root link, but has 2|child of two|loop"),
        (
            "</robot>",
            '<joint name="strut" type="fixed"><parent link="base"/><child link="fore"/></joint></robot>',
            "link 'fore' of two.urdf is the child of two joints",
        ),
        ('"elbow" type="revolute"', '"elbow" type="floating"', "'elbow' is not a movable joint"),
    ],
)
def test_a_bad_urdf(arm: Path, old: str, new: str, words: str) -> None:
    text = (arm / "two.urdf").read_text()
    assert old in text
    (arm / "two.urdf").write_text(text.replace(old, new))
    refused(arm, words)


@pytest.mark.parametrize("text", ["", "not xml", "\x00", "<robot name='x'/>", "<a>" * 5000 + "</a>" * 5000])
def test_what_is_no_urdf(arm: Path, text: str) -> None:
    (arm / "two.urdf").write_text(text)
    refused(arm, "two.urdf")


def test_a_chain_of_a_thousand_links(arm: Path) -> None:
    parts = ["<robot name='chain'><link name='l0'/>"]
    for i in range(1, 1200):
        inertia = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
        parts.append(f"<link name='l{i}'><inertial><mass value='1'/>{inertia}</inertial></link>")
        ends = f"<parent link='l{i - 1}'/><child link='l{i}'/><axis xyz='0 0 1'/>"
        name = {1: "shoulder", 2: "elbow"}.get(i, f"j{i}")
        parts.append(f"<joint name='{name}' type='continuous'>{ends}</joint>")
    (arm / "two.urdf").write_text("".join([*parts, "</robot>"]))
    refused(arm, "has 1199 joints")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("urdf", "no.urdf", "no.urdf does not exist"),
        ("urdf", ".", "bad.json: its URDF .* does not exist"),
        ("urdf", "/", "bad.json: its URDF / does not exist"),
        ("urdf", "embodiedreamer:none.urdf", "bad.json: its URDF .*none.urdf does not exist"),
        ("urdf", 3, "needs"),
        ("joints", ["shoulder", "knee"], "'knee' is not a movable joint of two.urdf; movable: shoulder, elbow"),
        ("joints", ["elbow", "elbow"], "of two.urdf are not unique"),
        ("joints", [], "names no joint"),
        ("joints", "elbow", "must be a list of names"),
        ("joints", None, "must be a list of names"),
        ("end_effectors", ["hand"], "'hand' is not a moving link of two.urdf; moving: upper, fore, tip"),
        ("end_effectors", ["base"], "'base' is not a moving link"),
        ("end_effectors", ["tip", "tip"], "of two.urdf are not unique"),
        ("end_effectors", "tip", "must be a list of names"),
        ("normalised", {"knee": [0, 1]}, "unknown key 'knee' in normalised"),
        ("normalised", {"elbow": [1, 1]}, "two different numbers"),
        ("normalised", {"elbow": [1]}, "2 finite numbers"),
        ("normalised", [0, 1], "must be an object"),
        ("tip", "tip", "unknown key 'tip' in robot"),
    ],
)
def test_a_bad_robot(arm: Path, key: str, value, words: str) -> None:
    data = json.loads((arm / "bad.json").read_text())
    data["robot"][key] = value
    (arm / "bad.json").write_text(json.dumps(data))
    refused(arm, words)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("robot", None, "needs"),
        ("robot", "two.urdf", "needs"),
        ("payload", 3, "unknown key 'payload'; known keys: name, robot, servo"),
        ("name", 3, "name must be a text"),
        ("servo", [1.0, 2.0], "servo must be an object"),
        ("servo", {"stifness": [1.0, 2.0]}, "unknown key 'stifness' in servo"),
        ("servo", {"stiffness": [1.0]}, "stiffness must be a list of 2 finite numbers"),
        ("servo", {"stiffness": [1.0, float("nan")]}, "2 finite numbers"),
        ("servo", {"stiffness": [1.0, True]}, "2 finite numbers"),
        ("servo", {"damping": [5.0, 1e308]}, "2 finite numbers of at most 1e.100"),
        ("servo", {"stiffness": [1.0, -1.0]}, "finite and not negative"),
        ("rotor_inertia", 0.1, "rotor_inertia must be a list of 2"),
        ("command_hold", "cubic", "not one of linear, hold, unknown"),
        ("command_hold", [1], "not one of linear, hold, unknown"),
        ("intervals", [1], "intervals must be an object"),
        ("intervals", {"stiffness[elbow]": 3}, "2 finite numbers"),
        ("intervals", {"stiffness[elbow]": ["a", "b"]}, "2 finite numbers"),
        ("effects", None, "effects must be a list"),
        ("effects", PAYLOAD, "effects must be a list"),
        ("effects", ["payload"], "an object with a name"),
        ("effects", [PAYLOAD, PAYLOAD], "listed twice"),
        ("effects", [{**PAYLOAD, "mass": {"tip": 60}}], "mass of tip is 60 kg, outside its bounds 0 .. 50"),
        ("effects", [{**PAYLOAD, "mass": {"hand": 1}}], "names 'hand'; its arms are tip"),
        ("effects", [{**COULOMB, "torque": {"knee": 1}}], "names 'knee'; its joints are shoulder, elbow"),
        ("effects", [{**COULOMB, "torque": "much"}], "must map joints to finite numbers"),
        ("effects", [{**COULOMB, "torque": [1]}], "2 finite numbers"),
    ],
)
def test_a_bad_model(arm: Path, key: str, value, words: str) -> None:
    data = json.loads((arm / "bad.json").read_text())
    data[key] = value
    (arm / "bad.json").write_text(json.dumps(data))
    refused(arm, words)


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ({"name": "magic"}, "no effect 'magic'; known effects: command_delay, command_lowpass"),
        ({"name": "payload", "weight": {"tip": 1}}, "payload has no parameter 'weight'; it has mass"),
    ],
)
def test_a_bad_effect(arm: Path, effect, words: str) -> None:
    data = json.loads((arm / "bad.json").read_text())
    (arm / "bad.json").write_text(json.dumps({**data, "effects": [effect]}))
    refused(arm, words, EffectError)
    refused(arm, "bad.json", EffectError)  # the file is named


@pytest.mark.parametrize("text", ["", "{", "[1]", "3", "null", "\x00", "[" * 100_000, '{"robot":' * 100_000])
def test_what_is_no_model(arm: Path, text: str) -> None:
    (arm / "bad.json").write_text(text)
    refused(arm, "bad.json")


def test_a_model_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"neither a file nor a built-in robot \(aloha, servo, so101\)"):
        RobotModel.load(tmp_path / "no.json")
    with pytest.raises(ModelError, match="neither a file"):
        RobotModel.load("no_such_robot")


@pytest.mark.parametrize(
    ("urdf", "says"),
    [
        ("two.urdf\x00", "cannot be a path"),
        ("x" * 5000, "does not exist"),
        ("loop.urdf", "loop.urdf does not exist"),
        ("null.urdf", "null.urdf does not exist"),
    ],
    ids=["null", "long", "loop", "device"],
)
def test_a_urdf_that_is_no_file_is_named(arm: Path, urdf: str, says: str) -> None:
    (arm / "loop.urdf").symlink_to("loop.urdf")
    (arm / "null.urdf").symlink_to("/dev/null")
    data = json.loads((arm / "bad.json").read_text())
    data["robot"]["urdf"] = urdf
    (arm / "bad.json").write_text(json.dumps(data))
    with pytest.raises(ModelError, match=says):
        RobotModel.load(arm / "bad.json")


def test_numbers_of_any_length_are_refused(arm: Path) -> None:
    data = json.loads((arm / "bad.json").read_text())
    data["rotor_inertia"] = [10**400, 0.0]
    (arm / "bad.json").write_text(json.dumps(data))
    with pytest.raises(ModelError, match="rotor_inertia must be a list of 2 finite numbers"):
        RobotModel.load(arm / "bad.json")
