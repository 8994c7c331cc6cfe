"""Key poses: cut from episodes, expressed in the frames in which they agree, and reached in new scenes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from embodiedreamer_gym.errors import PolicyError
from embodiedreamer_gym.policies.key_pose import KeyPosePolicy, Skill, learn
from embodiedreamer_gym.policies.key_pose.arms import Arms
from embodiedreamer_gym.policies.key_pose.cutting import cut, gripper_changes
from embodiedreamer_gym.policies.key_pose.frames import folded, mirrored
from embodiedreamer_gym.policies.key_pose.skill import Demonstration
from embodiedreamer_gym.robot import RobotModel
from tests.policies.key_pose.conftest import HOME, HZ, Draw, angle


@pytest.fixture(scope="module")
def skill(demonstrations: list[Demonstration], arms: Arms) -> Skill:
    return learn(demonstrations, arms)


def test_an_episode_is_cut_where_it_rests_and_where_the_gripper_changes(
    demonstrations: list[Demonstration], arms: Arms
) -> None:
    one = demonstrations[0]
    states = one.states if arms.acting(one.states) == 0 else arms.mirrored(one.states)
    keys = cut(states[:, :6], states[:, 6], HZ)
    assert [key.event for key in keys] == [False, True, False, False, True, False]
    assert np.abs(np.array([key.step for key in keys]) - [30, 60, 105, 135, 165, 210]).max() <= 2
    assert keys[1].departure - keys[1].step >= 14 and keys[1].opening == 0.0 and keys[4].opening == 1.0


def test_a_gripper_that_ramps_changes_once() -> None:
    opening = np.concatenate([np.ones(20), np.linspace(1, 0.1, 10), np.full(20, 0.1)])
    assert gripper_changes(opening).tolist() == [25]
    assert gripper_changes(np.full(20, 0.5)).size == 0


def test_frames_are_found_and_both_arms_agree(skill: Skill, demonstrations: list[Demonstration]) -> None:
    assert [key.frame for key in skill.keys] == ["bar"] * 3 + ["plate outward"] * 3
    assert max(key.spread for key in skill.keys) < 0.005
    assert len(skill.scenes) == len(demonstrations) and skill.side in ("bar", "plate")


def test_a_new_scene_gets_the_poses_of_its_own_demonstration(skill: Skill, demonstration: Draw, arms: Arms) -> None:
    for seed in range(5):
        new = demonstration(np.random.default_rng(100 + seed))
        right = arms.acting(new.states) == 1
        states = arms.mirrored(new.states) if right else new.states
        poses = skill.poses(mirrored(new.scene) if right else new.scene, arms.arm.base)
        for step, pose in zip((60, 165), (poses[1], poses[4]), strict=True):
            place, turn = arms.arm.pose(states[step, :6])
            assert np.linalg.norm(place - pose.position) < 0.004
            assert angle(turn, pose.rotation) < 0.03


def test_the_policy_goes_through_them(skill: Skill, demonstration: Draw, arms: Arms) -> None:
    """With the arm on whose side the things are; the other one and what lies behind the plan keep still."""
    for seed in (200, 201, 202, 203):
        new = demonstration(np.random.default_rng(seed))
        policy = KeyPosePolicy(skill, arms.model, lambda _, scene=new.scene: scene, HZ)
        way = policy({"agent_pos": HOME[None]})[0]
        assert way.shape == (300, 14)
        right = arms.acting(new.states) == 1
        assert np.ptp(way[:, :6] if right else way[:, 7:13], axis=0).max() < 1e-6
        states, seen = (arms.mirrored(x) if right else x for x in (new.states, way))
        for step in (60, 165):
            place = arms.arm.pose(states[step, :6])[0]
            closest = min(np.linalg.norm(arms.arm.pose(angles)[0] - place) for angles in seen[:, :6].astype(float))
            assert closest < 0.006
        assert gripper_changes(seen[:, 6]).size == 2
        assert np.array_equal(policy({"agent_pos": HOME[None]})[0, -1], way[-1])
        policy.reset()
        assert np.allclose(policy({"agent_pos": HOME[None]})[0], way)


def test_what_is_not_seen_or_not_reached_leaves_the_arm_still(skill: Skill, arms: Arms) -> None:
    far = {"bar": (3.0, 0.3, 0.0), "plate": (0.5, 0.3, 0.0)}
    for scene in (None, far, {"plate": (0.5, 0.3, 0.0)}):
        policy = KeyPosePolicy(skill, arms.model, lambda _, scene=scene: scene, HZ)
        assert np.allclose(policy({"agent_pos": HOME[None]})[0], HOME)


def test_json_brings_it_back(skill: Skill) -> None:
    again = Skill.of(json.loads(json.dumps(skill.as_dict())))
    scene = skill.scenes[0]
    for a, b in zip(skill.poses(scene, np.zeros(3)), again.poses(scene, np.zeros(3)), strict=True):
        assert np.allclose(a.position, b.position) and np.allclose(a.quaternion, b.quaternion)
    with pytest.raises(PolicyError, match="invalid key poses"):
        Skill.of({"keys": [{}]})


def test_episodes_of_another_form_are_left_out(demonstrations: list[Demonstration], arms: Arms) -> None:
    odd = demonstrations[0]
    idle = Demonstration(odd.states[:70], odd.actions[:70], HZ, odd.scene)
    assert len(learn([*demonstrations[:5], idle], arms).scenes) == 5
    with pytest.raises(PolicyError, match="only 1 of 2 demonstrations"):
        learn([odd, idle], arms)
    with pytest.raises(PolicyError, match="objects on the table"):
        learn([Demonstration(odd.states, odd.actions, HZ, {})], arms)


def test_robots_without_gripper_are_refused() -> None:
    with pytest.raises(PolicyError, match="gripper"):
        Arms(RobotModel.load("servo"))


def test_an_axis_has_no_direction() -> None:
    assert folded(0.3 + np.pi) == pytest.approx(0.3) and folded(-1.0) == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("speed", [0.1]), ("speed", 0.0), ("before", 1e9), ("frame", "spoon"), ("posture", [[0.0] * 6]), ("positions", [[float("nan")] * 3] * 12),
     ("rotations", [[[0.0] * 3] * 3] * 12), ("opening", None)],
)  # fmt: skip
def test_a_damaged_key_pose_is_one_sentence(skill: Skill, name: str, value) -> None:
    data = json.loads(json.dumps(skill.as_dict()))
    data["keys"][1][name] = value
    with pytest.raises(PolicyError, match="invalid key poses"):
        Skill.of(data)


@pytest.mark.parametrize("scene", [{}, {"bar": [0.5, 0.3]}, {"bar": [0.5, 0.3, 0.0]}])
def test_a_damaged_scene_is_one_sentence(skill: Skill, scene: dict) -> None:
    data = json.loads(json.dumps(skill.as_dict()))
    data["scenes"][1] = scene
    with pytest.raises(PolicyError, match="invalid key poses"):
        Skill.of(data)
