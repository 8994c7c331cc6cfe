"""What a URDF may not hold is refused in one sentence, wherever it is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.robot.forward_kinematics import EndEffector
from embodiedreamer_gym.robot.surface import Surface
from embodiedreamer_gym.robot.tree import build_tree
from embodiedreamer_gym.robot.urdf import MOST_BYTES, read_urdf, read_xml

JOINT = '<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>{inside}</joint>'


def urdf(shape: str = '<box size="1 2 3"/>', inside: str = "", link: str = "") -> str:
    visual = f"<visual>{link}<geometry>{shape}</geometry></visual>"
    return f'<robot name="r"><link name="base">{visual}</link><link name="arm"/>{JOINT.format(inside=inside)}</robot>'


BAD = {
    "nested": ("<a>" * 300 + "</a>" * 300, "nested more than 20 deep"),
    "no numbers": ('<box size="wide"/>', "cannot be read: ValueError"),
    "two sizes": ('<box size="1 2"/>', r"a box of link 'base' needs 3 positive sizes, m, not \[1.0, 2.0\]"),
    "four sizes": ('<box size="1 2 3 4"/>', "a box of link 'base' needs 3 positive sizes"),
    "an empty box": ('<box size=""/>', "a box of link 'base' needs 3 positive sizes"),
    "a flat box": ('<box size="1 0 1"/>', "needs 3 positive sizes"),
    "an endless box": ('<box size="1 1e999 1"/>', "needs 3 positive sizes"),
    "a ball": ('<sphere radius="-1"/>', "a sphere of link 'base' needs 1 positive sizes"),
    "a pipe": ('<cylinder radius="nan" length="1"/>', "a cylinder of link 'base' needs 2 positive sizes"),
    "no radius": ("<cylinder/>", "cannot be read: KeyError"),
    "a mesh's scale": ('<mesh filename="a.stl" scale="1 1"/>', "a mesh of link 'base' needs|cannot be read"),
    "a mesh without a name": ("<mesh/>", "a mesh of link 'base' needs a file name|cannot be read"),
    "no shape": ("", "cannot be read|has a shape"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_shape(case: str, tmp_path: Path) -> None:
    shape, words = BAD[case]
    path = tmp_path / "bad.urdf"
    path.write_text(urdf(shape))
    for read in (
        read_urdf,
        lambda p: EndEffector(p, "arm"),
        lambda p: Surface(p, []),
        lambda p: build_tree(p, ("turn",)),
    ):
        with pytest.raises(ModelError, match=words) as caught:
            read(path)
        assert "\n" not in str(caught.value) and "bad.urdf" in str(caught.value)


@pytest.mark.parametrize(
    ("inside", "words"),
    [
        ('<axis xyz="0 0 0"/>', "joint 'turn' .* has an axis of length zero"),
        ('<axis xyz="0 1"/>', "joint 'turn' .* axis of length zero|cannot be read"),
        ('<axis xyz="nan 0 1"/>', "the axis of joint 'turn' is not finite"),
        ('<origin xyz="0 inf 0"/>', "the origin of joint 'turn' is not finite"),
        ('<origin rpy="0 0"/>', "cannot be read"),
        ('<mimic joint="other" multiplier="x"/>', "cannot be read"),
    ],
)
def test_a_bad_joint(inside: str, words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        read_urdf(urdf(inside=inside))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["<robot>", "<robot/>", "<a/>", "< ", '<robot name="r"><link/></robot>', "<?xml"])
def test_what_is_no_urdf(text: str) -> None:
    with pytest.raises(ModelError):
        read_urdf(text)


def test_a_giant_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "giant.urdf"
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    with pytest.raises(ModelError, match="20 MB; at most 20 are read"):
        read_xml(path)


def test_a_good_one_is_read_as_text_and_as_file(tmp_path: Path) -> None:
    path = tmp_path / "good.urdf"
    path.write_text(urdf())
    for robot in (read_urdf(path), read_urdf(urdf())):
        assert [link.name for link in robot.links] == ["base", "arm"]
