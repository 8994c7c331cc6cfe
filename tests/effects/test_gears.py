"""Gears that give way: what motor and joint do on their two sides, worked out by hand on a pendulum."""

from __future__ import annotations

import numpy as np
import pytest

from embodiedreamer_gym.effects import Effect
from embodiedreamer_gym.effects.backlash import Backlash
from embodiedreamer_gym.effects.joint_elasticity import JointElasticity
from embodiedreamer_gym.simulation import TIME_STEP, Drive, simulate
from tests.bank import BUILT_IN, energy, fast, log, robot

WEIGHT = 9.81 * 0.15  # N m/rad, 1 kg whose centre hangs 0.15 m below the axis
SOFT = JointElasticity(compliance={"joint1": 0.02}, settling={"joint1": 0.0})


def every(model, value) -> dict[str, float]:
    return dict(zip(model.joints, np.broadcast_to(value, model.n).tolist(), strict=True))


@pytest.mark.parametrize(
    ("effect", "sag"),
    [(SOFT, lambda torque: 0.02 * torque), (Backlash(gap={"joint1": 0.04}), lambda torque: 0.02 * np.sign(torque))],
)
@pytest.mark.parametrize("command", [0.8, -0.8])
def test_the_joint_hangs_behind_its_motor(effect: Effect, sag, command: float) -> None:
    model = robot("pendulum1").with_effect(effect)
    time = np.arange(301) / 100
    run = simulate(model, log(model, time, np.full((301, 1), command)))
    seen, torque = run.position[-1, 0], run.torque[-1, 0]
    assert abs(run.velocity[-1, 0]) < 1e-4
    assert torque == pytest.approx(model.stiffness[0] * (command - seen), abs=1e-5)  # the servo sees the motor
    assert torque == pytest.approx(WEIGHT * np.sin(seen - sag(torque)), abs=1e-4)


@pytest.mark.parametrize("effect", [SOFT, Backlash(gap={"joint1": 0.04})])
def test_an_arm_at_rest_stays_so(effect: Effect) -> None:
    model = robot("pendulum1").with_effect(effect)
    time = np.arange(101) / 100
    torque = 1.0
    for _ in range(30):
        hangs = 0.02 * torque if effect is SOFT else 0.02
        torque = WEIGHT * np.sin(0.8 - hangs)
    command = np.full((101, 1), 0.8 + torque / model.stiffness[0])
    run = simulate(model, log(model, time, command, np.full((101, 1), 0.8)))
    np.testing.assert_allclose(run.position, 0.8, rtol=0, atol=2e-7)


@pytest.mark.parametrize("compliance", [0.1, 0.02, 0.005])
def test_a_link_rings_on_its_gear(compliance: float) -> None:
    """Behind a motor that does not move: I q'' = -q / compliance - weight."""
    still = dict.fromkeys(("stiffness", "damping", "viscous_friction"), np.zeros(1))
    model = robot("pendulum1").with_(rotor_inertia=np.full(1, 1e4), **still)
    drive = Drive(model.with_effect(JointElasticity(compliance={"joint1": compliance}, settling={"joint1": 0.0})))
    start = np.zeros((1, 1))
    drive.start(start, start, start)
    drive.velocity = np.full((1, 1), 0.1)
    path = []
    for _ in range(960):
        drive.advance(drive.accelerate(start))
        path.append(drive.position[0, 0])
    turns = np.flatnonzero(np.diff(np.sign(path)))
    frequency = (len(turns) - 1) / 2 / ((turns[-1] - turns[0]) * TIME_STEP)
    inertia = model.inertia_scale[0]
    assert frequency == pytest.approx(np.sqrt((1 / compliance + WEIGHT) / inertia) / (2 * np.pi), rel=0.02)
    late, early = np.abs(path[720:]).max(), np.abs(path[:240]).max()
    assert late == pytest.approx(early, rel=0.02), "nothing damps it but what is asked for"


def test_in_the_gap_a_motor_is_alone() -> None:
    model = robot("pendulum1").with_effect(Backlash(gap={"joint1": 0.2}))
    drive = Drive(model)
    rest = np.zeros((1, 1))
    drive.start(rest, rest, rest)
    for k in range(240):
        before = drive.spin[0, 0]
        drive.advance(drive.accelerate(np.full((1, 1), 0.05 * np.sin(0.1 * k))))
        assert abs(drive.position[0, 0]) < 1e-12
        if k > 2:
            rubs = model.viscous_friction[0] * (before + drive.spin[0, 0]) / 2
            motors = model.rotor_inertia[0] * drive.measured_acceleration[0, 0] + rubs
            assert drive.torque[0, 0] == pytest.approx(motors, abs=1e-9)
        assert drive.read()[0, 0] == pytest.approx(drive.motor[0, 0])


def test_a_motor_rubs_and_its_swinging_joint_does_not() -> None:
    model = robot("pendulum1").with_(stiffness=np.zeros(1), damping=np.zeros(1), viscous_friction=np.full(1, 50.0))
    drive = Drive(model.with_effect(JointElasticity(compliance={"joint1": 0.1}, settling={"joint1": 0.0})))
    start = np.full((1, 1), 0.2)
    drive.start(start, 0 * start, start)
    drive.velocity = np.full((1, 1), 2.0)
    path, seen = [], []
    for _ in range(240):
        drive.advance(drive.accelerate(start))
        path.append(drive.position[0, 0])
        seen.append(drive.motor[0, 0])
    assert np.ptp(path[-60:]) > 0.5 * np.ptp(path[:60]), "the joint swings on its spring"
    assert np.ptp(seen) < 0.2 * np.ptp(path)


def test_teeth_meet_without_rebound_and_keep_the_momentum() -> None:
    still = dict.fromkeys(("stiffness", "damping", "viscous_friction"), np.zeros(1))
    model = robot("pendulum1").with_(rotor_inertia=np.full(1, 0.01), **still)
    drive = Drive(model.with_effect(Backlash(gap={"joint1": 0.02})))
    rest = np.zeros((1, 1))
    drive.start(rest, rest, rest)
    drive.spin = np.full((1, 1), 1.0)
    for _ in range(6):
        drive.advance(drive.accelerate(rest))
    inertia = model.inertia_scale[0]
    both = 0.01 * 1.0 / (0.01 + inertia)
    assert drive.velocity[0, 0] == pytest.approx(both, rel=0.01)
    assert drive.spin[0, 0] == pytest.approx(both, rel=0.01)
    assert drive.motor[0, 0] - drive.position[0, 0] == pytest.approx(0.01, abs=1e-6)


@pytest.mark.parametrize("hard", [False, True])
@pytest.mark.parametrize("name", ["joint_elasticity", "backlash"])
def test_gears_never_add_energy(name: str, hard: bool) -> None:
    """An arm without power swings from rest; its links', rotors' and springs' energy does not rise."""
    still = dict.fromkeys(("stiffness", "damping", "viscous_friction"), np.zeros(6))
    model = robot("arm6").with_(**still)
    links = model.with_(rotor_inertia=np.zeros(6))
    compliance = (0.001 if hard else 0.02) / model.torque_scale
    effect = JointElasticity(compliance=every(model, compliance), settling=every(model, 0.002))
    if name == "backlash":
        effect = Backlash(gap=every(model, 0.005 if hard else 0.05))
    drive = Drive(model.with_effect(effect), dt=1e-3)
    pose = np.array([[0.3, -0.5, 0.9, 0.4, 0.3, 0.2]])
    drive.start(pose, 0 * pose, pose)
    levels = []
    for _ in range(800):
        v, w, q, wound = drive.velocity, drive.spin, drive.position, drive.motor - drive.position
        drive.advance(drive.accelerate(pose))
        v, w = (v + drive.velocity)[0] / 2, (w + drive.spin)[0] / 2
        spring = np.sum(wound**2 / compliance) / 2 if name == "joint_elasticity" else 0.0
        levels.append(energy(links, q[0], v) + 0.5 * w @ (model.rotor_inertia * w) + spring)
    rise = np.max(levels - np.minimum.accumulate(levels))
    assert rise < 0.02 * (energy(links, pose[0], 0 * pose[0]) - energy(links, q[0], 0 * q[0]) + 10.0)


def test_a_stiffer_gear_comes_nearer_to_none() -> None:
    model = robot("arm6")
    recording = fast(model, 1.5)
    rigid = simulate(model, recording)
    apart = []
    for size in (1e-2, 1e-3, 1e-4, 1e-5):
        soft = JointElasticity(compliance=every(model, size / model.torque_scale))
        apart.append(np.abs(simulate(model.with_effect(soft), recording).position - rigid.position).max())
    assert apart[0] > 3e-3 and apart[1] < 0.2 * apart[0] and apart[2] < 0.2 * apart[1] and apart[3] < 0.2 * apart[2]
    tiny = Backlash(gap=every(model, 1e-9))
    assert np.abs(simulate(model.with_effect(tiny), recording).position - rigid.position).max() < 1e-4


@pytest.mark.parametrize("size", [0.01, 0.2, 1.0])
@pytest.mark.parametrize("name", BUILT_IN)
def test_gears_of_any_size_do_not_explode(name: str, size: float) -> None:
    """Up to the bounds' ends, alone and together, in a robot with fast moves."""
    model = robot(name)
    (compliance, settling), (gap,) = JointElasticity.parameters, Backlash.parameters
    give, wide = (every(model, size * model.parameter_bounds(p)[1]) for p in (compliance, gap))
    recording = fast(model, 1.5)
    for effects in (
        (JointElasticity(compliance=give, settling=every(model, settling.low)),),
        (JointElasticity(compliance=give, settling=every(model, settling.high)),),
        (Backlash(gap=wide),),
        (JointElasticity(compliance=give), Backlash(gap=wide)),
    ):
        run = simulate(model.with_(effects=effects), recording)
        assert np.abs(run.velocity).max() < 60
        assert np.abs(run.position - recording.position).max() < 3.0
