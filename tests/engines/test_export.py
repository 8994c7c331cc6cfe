"""Exported MJCF: each effect moves plain MuJoCo as it moves the package's rollouts, and the file says what it cannot."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from embodiedreamer_gym.effects import CATALOGUE, NUISANCES, MechanicsChange, Parameter
from embodiedreamer_gym.engines.export import export_model
from embodiedreamer_gym.engines.export.effects import MJCF, MJCF_BODIES
from embodiedreamer_gym.engines.export.parts import parts_of
from embodiedreamer_gym.engines.export.replay import agreement, replay_mjcf
from embodiedreamer_gym.engines.mujoco.library import mujoco
from embodiedreamer_gym.errors import ModelError
from embodiedreamer_gym.recordings import Recording
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.simulation import simulate
from embodiedreamer_gym.simulation.drive import TIME_STEP
from tests.two_joint_arm import load_arm, record, wave

FRICTION = ("coulomb_friction", "stribeck_friction", "direction_dependent_friction")
LIMITS = ("torque_saturation", "voltage_limit")
FIRMWARE = ("profile", "lookahead", "derivative_on_error", "friction_compensation", "gravity_compensation", "integral_action",
            "velocity_cascade", "pwm_deadband", "supply_sag")  # fmt: skip
LOST = ("servo_deadzone", "torque_fade", "load_friction", "joint_elasticity", "backlash", *FIRMWARE)
EXPORTED = sorted({*CATALOGUE, "inertial_error"} - {*LOST, "timestamp_jitter"})


def typical(model: RobotModel, name: str, share: float = 1.0) -> RobotModel:
    """The model with an effect at a share of its typical size; limits at twice it."""
    model = model.with_effect({**CATALOGUE, **NUISANCES}[name])
    values = {}
    for p in next(e for e in model.effects if e.name == name).parameters:
        size = 2.0 if p.off == p.high else share
        factor = model.parameter_bounds(p)[1] / p.high
        values[f"{name}.{p.name}"] = dict(zip(model.places(p), (size * p.typical * factor).tolist(), strict=True))
    return model.with_values(values)


@pytest.fixture
def log(tmp_path: Path) -> Recording:
    """Two and a half seconds of the arm without effects."""
    return record(load_arm(tmp_path), command=2 * wave(2.0))


def gap(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max())


@pytest.mark.parametrize("name", EXPORTED)
def test_an_effect_moves_mujoco_as_it_moves_the_rollout(name: str, tmp_path: Path, log: Recording) -> None:
    plain = load_arm(tmp_path).with_(viscous_friction=[0.2, 0.1])
    model = typical(plain, name)
    export = export_model(model, tmp_path / "arm.xml")
    assert name in {line.name for line in export.written}
    tolerance, step = 1e-3 if name in FRICTION else 3e-4, TIME_STEP
    if name in LIMITS:
        step = TIME_STEP / 16  # where the torque is limited, the rollout itself errs by more at its own step
    assert agreement(export.path, model, [log], step).largest.max() < tolerance
    assert gap(replay_mjcf(export.path, model, log), simulate(plain, log).position) > 3 * tolerance, "it must matter"


def test_many_effects_at_once(tmp_path: Path, log: Recording) -> None:
    model = load_arm(tmp_path)
    for name in ("command_delay", "stribeck_friction", "hysteresis", "payload", "torque_bias", "encoder_offset", "joint_spring",
                 "torque_ripple"):  # fmt: skip
        model = typical(model, name, 0.5)
    export = export_model(model, tmp_path / "arm.xml")
    assert export.lost == () and agreement(export.path, model, [log]).largest.max() < 1e-3


def test_a_motor_with_a_constant_torque_a_gain_and_a_ramp(tmp_path: Path, log: Recording) -> None:
    model = load_arm(tmp_path)
    for name in ("torque_constant", "voltage_limit", "torque_bias", "command_rate_limit"):
        model = typical(model, name, 0.5)
    export = export_model(model, tmp_path / "arm.xml")
    assert export.lost == () and agreement(export.path, model, [log], export.timestep or 0).largest.max() < 3e-4
    uneven = model.with_values({"voltage_limit.forward": {"elbow": 3.0}})
    export = export_model(uneven, tmp_path / "arm.xml")
    assert [line.name for line in export.lost] == ["voltage_limit"] and "mean slope" in export.lost[0].text


@pytest.mark.parametrize("name", LOST)
def test_what_is_not_exported_is_listed_with_what_it_does(name: str, tmp_path: Path) -> None:
    export = export_model(typical(load_arm(tmp_path), name), tmp_path / "arm.xml")
    assert [(line.name, line.text) for line in export.lost] == [(name, CATALOGUE[name].symptom)]
    words = " ".join(CATALOGUE[name].symptom.split()[:3])
    assert name in str(export) and words in str(export)
    assert name in export.path.read_text() and words in export.path.read_text()
    assert export.as_dict()["not_exported"] == {name: CATALOGUE[name].symptom}


def test_a_nominal_gravity_compensation_is_listed(tmp_path: Path) -> None:
    export = export_model(load_arm(tmp_path).with_(gravity_compensation=1.0), tmp_path / "arm.xml")
    assert [line.name for line in export.lost] == ["gravity_compensation"]


def test_a_property_of_the_log_is_no_loss(tmp_path: Path) -> None:
    export = export_model(typical(load_arm(tmp_path), "timestamp_jitter"), tmp_path / "arm.xml")
    assert "nothing is lost" in export.lost[0].text


def test_a_filter_and_a_ramp_do_not_go_together(tmp_path: Path) -> None:
    model = typical(typical(load_arm(tmp_path), "command_lowpass"), "command_rate_limit")
    export = export_model(model, tmp_path / "arm.xml")
    assert [line.name for line in export.lost] == ["command_lowpass"] and "filter the commands" in export.lost[0].text
    assert "command_lowpass" not in {line.name for line in export.written}


def test_a_users_change_of_masses_needs_no_entry(tmp_path: Path, log: Recording) -> None:
    class HeavyForearm(MechanicsChange):
        name = "heavy_forearm"
        parameters = (Parameter("mass", "kg", off=0.0, low=0.0, high=5.0, typical=1.0),)
        symptom, reveals = "it is heavy", "weighing it"

        @staticmethod
        def change(mechanics: Any, p: Any) -> None:
            mechanics.add_point_mass(1, p.mass[:, 1], np.array([0.1, 0.0, 0.0]))

    model = load_arm(tmp_path).with_effect(HeavyForearm(mass={"elbow": 1.0}))
    export = export_model(model, tmp_path / "arm.xml", recordings=[log])
    assert export.written[-1].text == "body: inertial" and export.lost == ()
    assert export.agreement is not None and export.agreement.largest.max() < 3e-4


def test_an_older_mujoco_says_what_it_lacks(tmp_path: Path) -> None:
    old = SimpleNamespace(__version__="3.3.0")
    model = typical(typical(load_arm(tmp_path), "command_delay"), "stribeck_friction")
    parts = parts_of(model, MJCF, MJCF_BODIES, old)
    lost = {line.name: line.text for line in parts.lost}
    assert "MuJoCo 3.3.0 has no delay" in lost["command_delay"] and "near standstill" in lost["stribeck_friction"]
    assert not parts.joints.delay.any() and not parts.joints.extra_static.any() and parts.joints.dry_friction.all()


def test_the_step_is_chosen_by_what_the_model_contains(tmp_path: Path) -> None:
    model = load_arm(tmp_path)
    steps = {}
    for name in ("", "torque_saturation", "command_lowpass"):
        export = export_model(typical(model, name) if name else model, tmp_path / "arm.xml")
        steps[name] = export.timestep
        written = mujoco.MjModel.from_xml_path(str(export.path)).opt.timestep
        assert written == pytest.approx(export.timestep, rel=1e-5) and f"{1e3 * written:.3g}"[:4] in export.notes[0]
    assert steps == {"": 1 / 480, "torque_saturation": 1 / 3840, "command_lowpass": 1 / 1920}
    assert export_model(model, tmp_path / "arm.xml", timestep=0.001).timestep == 0.001
    assert 'timestep="0.001"' in (tmp_path / "arm.xml").read_text()


def test_two_arms_with_grippers(tmp_path: Path) -> None:
    """Names, followers, units of a normalised gripper, and a tilt of its own for each arm."""
    model = typical(RobotModel.load("aloha"), "base_tilt").with_values({"base_tilt.roll": {"left_gripper_tip": -0.1}})
    home = np.array([0.0, 1.57, -1.3485, 0.0, 0.0, 0.0, 0.6] * 2)
    time = np.arange(60) / 50
    command = home + 0.2 * np.sin(4 * time)[:, None]
    log = Recording(name="log", joints=model.joints, time=time, position=command, command=command, units=model.units)
    export = export_model(model, tmp_path / "aloha.xml", recordings=[log])
    assert export.agreement is not None and export.agreement.largest.max() < 3e-4
    flat = export_model(model.without_effect("base_tilt"), tmp_path / "flat.xml")
    assert gap(replay_mjcf(flat.path, model, log), simulate(model, log).position) > 1e-3
    world = mujoco.MjModel.from_xml_path(str(export.path))
    assert [world.actuator(i).name for i in range(world.nu)] == list(model.joints) and world.neq == 2
    assert world.joint("left_gripper").range == pytest.approx([0.0, 0.035])
    assert any("left_gripper is recorded as 0 to 1; here it is 0 to 0.035" in note for note in export.notes)


def test_links_touch_things_and_not_each_other(tmp_path: Path) -> None:
    root = ElementTree.parse(export_model(RobotModel.load("so101"), tmp_path / "arm.xml").path).getroot()
    shapes = [geom for geom in root.iter("geom") if geom.get("contype") != "0"]
    assert shapes and all(geom.get("conaffinity") == "0" for geom in shapes)


def test_another_format_and_a_file_of_another_robot(tmp_path: Path, log: Recording) -> None:
    model = load_arm(tmp_path)
    with pytest.raises(ModelError, match="'sdf' is not one of mjcf, urdf"):
        export_model(model, tmp_path / "arm.sdf", "sdf")
    (tmp_path / "no.xml").write_text("<mujoco><nothing/></mujoco>")
    with pytest.raises(ModelError, match="MuJoCo cannot read"):
        replay_mjcf(tmp_path / "no.xml", model, log)
