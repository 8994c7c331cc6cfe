"""Exported URDFs, meshes beside exported files, and the verb."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from embodiedreamer_gym.cli import main
from embodiedreamer_gym.engines.export import export_model
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.recordings import save_recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation.drive import Drive
from tests.two_joint_arm import load_arm, record, wave, write_arm

EFFECTS = [
    {"name": "payload", "mass": {"tip": 0.5}, "x": {"tip": 0.02}},
    {"name": "inertial_error", "mass": {"shoulder": 0.1}, "x": {"elbow": -0.01}, "stretch_y": {"elbow": 0.05}},
    {"name": "coulomb_friction", "torque": {"shoulder": 0.3}},
    {"name": "torque_saturation", "limit": {"elbow": 4.0}},
    {"name": "torque_bias", "torque": {"elbow": 0.1}},
]


def model_with(folder: Path, urdf: Path) -> RobotModel:
    return RobotModel.load(write_arm(folder, "read", robot={
        "urdf": urdf.name, "joints": ["shoulder", "elbow"], "end_effectors": ["tip"]}))  # fmt: skip


def test_a_urdf_reads_back_with_the_same_mechanics(tmp_path: Path) -> None:
    model = RobotModel.load(write_arm(tmp_path, effects=EFFECTS, viscous_friction=[0.2, 0.1]))
    export = export_model(model, tmp_path / "better.urdf", "urdf")
    assert [line.name for line in export.lost] == ["servo", "rotor inertia", "torque_bias"]
    read, wanted = model_with(tmp_path, export.path).nominal_mechanics, Drive(model).mechanics
    for name in ("mass", "first_moment", "inertia"):
        np.testing.assert_allclose(getattr(read, name), getattr(wanted, name), rtol=1e-9, atol=1e-12)
    assert not np.allclose(read.mass, model.nominal_mechanics.mass)
    joints = {joint.get("name"): joint for joint in ElementTree.parse(export.path).getroot().iter("joint")}

    def number(joint: str, tag: str, key: str) -> float:
        return float(joints[joint].find(tag).get(key))  # pyright: ignore

    assert number("shoulder", "dynamics", "friction") == 0.3 and number("shoulder", "dynamics", "damping") == 0.2
    assert number("elbow", "limit", "effort") == 4.0 and number("shoulder", "limit", "effort") == 50.0


def test_unchanged_links_stay_as_they_are(tmp_path: Path) -> None:
    """The demo's tool keeps its own inertial; with a payload it is part of the link that moves it."""
    arm = load_arm(tmp_path)
    tool = '<link name="tip"><inertial><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>'
    arm.urdf.write_text(arm.urdf.read_text().replace('<link name="tip"/>', tool))
    masses = {}
    for name, effects in (("plain", []), ("loaded", EFFECTS[:1])):
        model = RobotModel.load(write_tool(tmp_path, effects))
        root = ElementTree.parse(export_model(model, tmp_path / f"{name}.urdf", "urdf").path).getroot()
        masses[name] = {str(link.get("name")): link.findall("inertial/mass") for link in root.iter("link")}
    assert float(masses["plain"]["tip"][0].get("value")) == 0.2
    assert masses["loaded"]["tip"] == [] and float(masses["loaded"]["fore"][0].get("value")) == pytest.approx(1.3)


def test_a_joint_that_the_model_does_not_drive_is_fixed(tmp_path: Path) -> None:
    arm = load_arm(tmp_path)
    arm.urdf.write_text(arm.urdf.read_text().replace('name="end" type="fixed"', 'name="end" type="continuous"'))
    model = RobotModel.load(write_tool(tmp_path, []))
    for to in ("mjcf", "urdf"):
        export = export_model(model, tmp_path / "arm.xml", to)
        assert "The model does not drive end: fixed at zero." in export.notes
    assert 'name="end" type="fixed"' in (tmp_path / "arm.xml").read_text()


def write_tool(folder: Path, effects: list[dict]) -> Path:
    """A model of the URDF that is there."""
    text = (folder / "two.urdf").read_text()
    path = write_arm(folder, effects=effects)
    (folder / "two.urdf").write_text(text)
    return path


@pytest.mark.parametrize("to", ["mjcf", "urdf"])
def test_meshes_go_along(to: str, tmp_path: Path) -> None:
    """Two meshes of one name are kept apart; what is copied loads where the folder is moved to."""
    arm = load_arm(tmp_path)
    for side in ("a", "b"):
        (tmp_path / side).mkdir()
        trimesh.creation.box((0.1, 0.02, 0.03 if side == "a" else 0.05)).export(tmp_path / side / "link.stl")
    text = arm.urdf.read_text()
    for link, side in (("upper", "a"), ("fore", "b")):
        visual = f'<visual><geometry><mesh filename="{side}/link.stl"/></geometry></visual>'
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{visual}')
    arm.urdf.write_text(text)
    (tmp_path / "out").mkdir()
    export = export_model(arm, tmp_path / "out" / "arm.xml", to)
    assert sorted(path.name for path in (tmp_path / "out").rglob("*")) == [
        "arm.xml", "arm_meshes", "link.stl", "link_1.stl"
    ]  # fmt: skip
    assert any("arm_meshes" in note for note in export.notes)
    moved = (tmp_path / "out").rename(tmp_path / "moved")
    if to == "mjcf":
        assert mujoco.MjModel.from_xml_path(str(moved / "arm.xml")).nmesh == 2
    else:
        names = [str(mesh.get("filename")) for mesh in ElementTree.parse(moved / "arm.xml").getroot().iter("mesh")]
        sizes = [trimesh.load_mesh(moved / name).extents[2] for name in names]
        assert sizes == pytest.approx([0.03, 0.05])


def test_a_missing_mesh_is_left_out_of_an_mjcf_and_kept_in_a_urdf(tmp_path: Path) -> None:
    arm = load_arm(tmp_path)
    name = "package://arm/upper.stl"
    visual = f'<link name="upper"><visual><geometry><mesh filename="{name}"/></geometry></visual>'
    arm.urdf.write_text(arm.urdf.read_text().replace('<link name="upper">', visual))
    export = export_model(arm, tmp_path / "arm.xml")
    assert mujoco.MjModel.from_xml_path(str(export.path)).nmesh == 0
    assert any(name in note for note in export.notes) and not (tmp_path / "arm_meshes").exists()
    assert f'filename="{name}"' in export_model(arm, tmp_path / "arm.urdf", "urdf").path.read_text()


def test_the_verb_prints_what_it_wrote_and_how_a_replay_agrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    arm = load_arm(tmp_path)
    save_recording(record(arm, "log", command=wave(1.0)), "log.csv")
    words = ["export", "--model", "two.json", "--to", "mjcf", "--out", "arm.xml"]
    assert main([*words, "log.csv", "--json", "out.json", "--quiet"]) == 0
    out = capsys.readouterr().out
    assert "actuator: gainprm" in out and "not exported: nothing" in out and "mrad at most" in out
    data = json.loads(Path("out.json").read_text())
    assert data["exported"]["rotor inertia"] == "joint: armature" and 0 < data["agreement"]["largest_rad"] < 3e-4
    assert main([*words, "--timestep", "0.001"]) == 0  # an older file is replaced
    assert 'timestep="0.001"' in Path("arm.xml").read_text()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--to", "sdf", "--out", "a.xml"], "invalid choice: 'sdf'"),
        (["--to", "urdf", "--out", "two.urdf"], "two.urdf is the model's own URDF"),
        (["--to", "urdf", "--out", "a.urdf", "--timestep", "0.001"], "a URDF has neither a time step"),
        (["--to", "mjcf", "--out", "no/a.xml"], "folder"),
    ],
)
def test_bad_options_are_one_sentence(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    before = load_arm(tmp_path).urdf.read_text()
    assert main(["export", "--model", "two.json", *words]) == 2
    err = capsys.readouterr().err.splitlines()[-1]
    assert err.startswith("error: ") and sentence in err
    assert (tmp_path / "two.urdf").read_text() == before and sorted(p.name for p in tmp_path.iterdir()) == [
        "two.json",
        "two.urdf",
    ]
