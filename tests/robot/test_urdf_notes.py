"""URDFs with placeholders, other units and missing meshes: one sentence each, and none for a good one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from embodiedreamer_gym.cli import main
from embodiedreamer_gym.engines.clearance import clearance, without_shape
from embodiedreamer_gym.recordings import save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.urdf_notes import urdf_notes
from tests.two_joint_arm import load_arm, record, write_arm


def write(folder: Path, links: list[tuple[float, float, float]], shape: str = "") -> Path:
    """A chain of links with these masses and inertias about x and about y and z."""
    text = '<robot name="chain"><link name="base"/>'
    for k, (mass, along, across) in enumerate(links):
        inertia = f'<inertia ixx="{along}" ixy="0" ixz="0" iyy="{across}" iyz="0" izz="{across}"/>'
        parent = f"link{k - 1}" if k else "base"
        text += f'<link name="link{k}"><inertial><mass value="{mass}"/>{inertia}</inertial>{shape}</link>'
        text += (
            f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/><axis xyz="0 1 0"/>'
        )
        text += '<origin xyz="0.2 0 0"/><limit lower="-1" upper="1" effort="9" velocity="3"/></joint>'
    (folder / "chain.urdf").write_text(text + "</robot>")
    return folder / "chain.urdf"


GOOD = [(1.0, 0.001, 0.006), (0.8, 0.001, 0.004), (0.3, 0.0002, 0.0009), (1e-6, 1e-9, 1e-9)]


@pytest.mark.parametrize("name", ["aloha", "so101", "servo"])
def test_the_built_in_robots_and_a_good_urdf_have_no_note(name: str, tmp_path: Path) -> None:
    assert urdf_notes(RobotModel.load(name).urdf) == () and urdf_notes(write(tmp_path, GOOD)) == ()


@pytest.mark.parametrize(
    ("links", "message"),
    [
        ([(1.0, 0.001, 0.001)] * 3, "all 3 moving links have a mass of 1 kg"),
        ([(1.0, 0.001, 0.004), (1.0, 0.002, 0.005), (1.0, 0.001, 0.003)], "all 3 moving links have a mass of 1 kg"),
        ([(1.0, 0.02, 0.02), (0.5, 0.02, 0.02), (0.2, 0.02, 0.02)], r"same inertia, 0\.02 kg m\^2"),
        ([(1.0, 0.001, 0.001), (0.5, 0.01, 0.01), (0.2, 0.001, 0.002)], "2 of 3 moving links have a round inertia"),
        ([(1.0, 1e3, 6e3), *GOOD[1:]], r"inertia and mass of link0 \(8.06e\+04 mm\) do not fit"),
        ([(1.0, 1e-9, 1e-8), *GOOD[1:]], r"link0 \(0\.102 mm\)"),
        ([(1.0, 0.013, 0.006), *GOOD[1:]], "no body can have the inertia of link0, which is larger about one axis"),
    ],
)
def test_what_looks_made_up_is_said_with_what_follows(tmp_path: Path, links: list, message: str) -> None:
    (note,) = urdf_notes(write(tmp_path, links))
    with pytest.raises(ValueError, match=message):
        raise ValueError(note)
    assert note.startswith("chain.urdf: ") and "rotor inertia may only compensate for" in note and "\n" not in note


def test_missing_meshes_are_counted_and_left_out_of_clearance(tmp_path: Path) -> None:
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "here.stl")
    shape = '<collision><geometry><mesh filename="package://arm/{}.stl"/></geometry></collision>'
    urdf = write(tmp_path, GOOD[:3], shape.format("here") + shape.format("gone"))
    (note,) = urdf_notes(urdf)
    assert note.startswith(
        "chain.urdf: 1 of 2 meshes are not found (package://arm/gone.stl): results do not depend on them"
    )
    (tmp_path / "chain.json").write_text('{"robot": {"urdf": "chain.urdf", "joints": ["j0", "j1", "j2"]}}')
    assert without_shape(RobotModel.load(tmp_path / "chain.json")) == ()
    room = clearance(RobotModel.load(tmp_path / "chain.json"), np.zeros((1, 3)), table=-0.15)
    assert room[0] == pytest.approx(0.1, abs=1e-3)  # of the boxes that are there


def test_the_sentence_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    save_recording(record(load_arm(tmp_path)), "log.csv")
    path = write_arm(tmp_path)
    text = Path("two.urdf").read_text()
    Path("two.urdf").write_text(
        text.replace(
            '<link name="base"/>',
            '<link name="base"><visual><geometry><mesh filename="a.stl"/></geometry></visual></link>',
        )
    )
    assert main(["compare", "--model", str(path), "log.csv", "--quiet"]) == 0
    assert "warning: two.urdf: 1 of 1 meshes are not found (a.stl)" in capsys.readouterr().err


def test_links_without_collision_shape_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seen = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    write(tmp_path, GOOD[:3], seen)
    (tmp_path / "chain.json").write_text('{"robot": {"urdf": "chain.urdf", "joints": ["j0", "j1", "j2"]}}')
    assert without_shape(RobotModel.load(tmp_path / "chain.json")) == ("link0", "link1", "link2")
    main(["excite", "--model", str(tmp_path / "chain.json"), "--separate", "coulomb_friction,payload", "--seconds", "1",
          "--table", "-5", "--out", str(tmp_path / "motion.csv"), "--quiet"])  # fmt: skip
    assert "link0, link1, link2 have no collision shape" in capsys.readouterr().err
