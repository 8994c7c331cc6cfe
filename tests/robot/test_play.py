"""Playing a motion on an arm: rate, limits, stamps, stops, and the examples with LeRobot's and ROS's classes replaced."""

from __future__ import annotations

import runpy
import sys
from math import degrees
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from embodiedreamer_gym.errors import RecordingError, RobotError
from embodiedreamer_gym.recordings import load_recordings, save_recording
from embodiedreamer_gym.recordings.motor_units import MotorUnits
from embodiedreamer_gym.robot import RobotModel
from embodiedreamer_gym.robot.play import ModelArm, SafeMotion, Sample, play
from tests.two_joint_arm import load_arm, write_arm

EXAMPLES = Path(__file__).parents[2] / "examples"


class FakeArm:
    """Servos that follow with a lag of 50 ms, a bus that takes 3 ms to read, and a clock that only they move."""

    def __init__(self, n: int = 2, start: float = 0.2) -> None:
        self.clock, self.position, self.target = 100.0, np.full(n, start), np.full(n, start)
        self.sent: list[tuple[float, np.ndarray]] = []
        self.blocked = self.dead = self.broken = False
        self.slow_at = np.inf

    def move(self, seconds: float) -> None:
        self.clock += seconds
        if not self.blocked:
            self.position = self.target + (self.position - self.target) * np.exp(-seconds / 0.05)

    def now(self) -> float:
        return self.clock

    def wait(self, until: float) -> None:
        self.move(max(until - self.clock, 0.0))

    def read(self) -> Sample:
        self.move(0.0015)
        stamp, position = self.clock, self.position * (np.nan if self.broken else 1.0)
        self.move(0.0015 if self.clock < self.slow_at else 0.11)
        self.slow_at = np.inf if self.clock > self.slow_at else self.slow_at
        return Sample(50.0 if self.dead else stamp, position, effort=self.target - position)

    def write(self, command: np.ndarray) -> None:
        self.sent.append((self.clock, command.copy()))
        self.target = command


@pytest.fixture
def model(tmp_path: Path) -> RobotModel:
    return load_arm(tmp_path)


@pytest.fixture
def commands(tmp_path: Path) -> Path:
    """Two seconds at 50 Hz, the joints in another order than the model's, as `excite` writes them."""
    time = np.arange(100) / 50
    wave = 0.3 * np.sin(np.pi * time) ** 2
    rows = np.column_stack([time, -wave, 0.5 + wave])
    path = tmp_path / "next.csv"
    np.savetxt(path, rows, "%.6f", ",", header="time,elbow.command,shoulder.command", comments="")
    return path


def test_commands_are_sent_at_their_rate_and_logged_with_measured_stamps(model, commands, tmp_path) -> None:
    arm, motion = FakeArm(), SafeMotion.load(commands, model)
    log = play(arm, motion, "next")
    assert log.joints == ("shoulder", "elbow") and log.command_hold == "hold" and not log.nominal_time
    played = arm.sent[-len(motion.time) :]
    assert np.allclose(np.diff([t for t, _ in played]), 0.02) and log.notes == ()
    assert np.array_equal([u for _, u in played], motion.command) and np.array_equal(log.command, motion.command)
    assert np.allclose(np.diff(log.time), 0.02) and np.allclose(log.position, log.command, atol=0.1)
    assert np.allclose(log.effort, log.command - log.position)
    ramp = np.diff([u for _, u in arm.sent[: -len(motion.time)]], axis=0)
    assert len(ramp) > 30 and np.abs(ramp).max() <= 0.3 / 50 + 1e-9  # from 0.2 to 0.5 and 0, slowly
    (again,) = load_recordings(save_recording(log, tmp_path / "log.csv"))
    assert np.array_equal(again.time, log.time) and np.array_equal(again.position, log.position)


def test_late_commands_are_left_out_not_caught_up(model, commands) -> None:
    arm = FakeArm()
    arm.slow_at = 102.0
    log = play(arm, SafeMotion.load(commands, model))
    assert log.notes == ("4 of 100 commands were late and left out",)
    assert len(log.time) == 96 and np.diff([t for t, _ in arm.sent]).min() > 0.0029
    sent = np.array([t for t, _ in arm.sent])
    for t, u in zip(
        log.time + arm.sent[-96][0] + 0.0015, log.command, strict=True
    ):  # stamps are of the middle of reading
        assert np.array_equal(u, arm.sent[int(np.searchsorted(sent, t)) - 1][1])


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("blocked", "stopped: shoulder is 0.3.. from its command"),
        ("broken", "not a number for each"),
        ("dead", "s old"),
    ],
)
def test_a_fault_stops_the_arm_where_it_is(model, commands, fault: str, message: str) -> None:
    arm, motion = FakeArm(start=0.1), SafeMotion.load(commands, model)
    arm.wait(101.0)
    setattr(arm, fault, True)
    with pytest.raises(RobotError, match=message):
        play(arm, motion)
    assert np.allclose(arm.target, [0.1, 0.1], atol=2e-3) and len(arm.sent) <= {"broken": 0, "dead": 2}.get(fault, 99)


def test_an_interrupt_stops_the_arm_where_it_is(model, commands) -> None:
    class Interrupted(FakeArm):
        def wait(self, until: float) -> None:
            if len(self.sent) == 80:
                raise KeyboardInterrupt
            super().wait(until)

    arm = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        play(arm, SafeMotion.load(commands, model))
    assert len(arm.sent) == 81 and np.allclose(arm.target, arm.position, atol=0.02)


def test_commands_beyond_the_limits_are_refused_before_anything_moves(model, commands, tmp_path) -> None:
    with pytest.raises(RobotError, match=rf"{commands.name}: .*faster than its limit of 0\.50"):
        SafeMotion.load(commands, model, speed=0.5)
    text = commands.read_text()
    commands.write_text(text.replace(",0.800000", ",9.000000"))
    with pytest.raises(
        RobotError, match=rf"{commands.name}: shoulder is sent to 0.5 .. 9, beyond its limits -3.000 .. 3.000"
    ):
        SafeMotion.load(commands, model)
    commands.write_text(text.replace("elbow", "knee"))
    with pytest.raises(RobotError, match="commands knee, shoulder, but the model's joints are shoulder, elbow"):
        SafeMotion.load(commands, model)
    commands.write_text(text.replace("0.040000,", "0.020000,"))
    with pytest.raises(RecordingError, match="times do not increase"):
        SafeMotion.load(commands, model)
    commands.write_text("time,a.position\n0,1\n")
    with pytest.raises(RecordingError, match=r"no column <joint>\.command"):
        SafeMotion.load(commands, model)


def test_motors_units_and_gears_lie_between(commands, tmp_path) -> None:
    part = {"matrix": [[0.5, 0.0], [-0.5, 0.25]], "sign": {"elbow": -1}, "zero": {"shoulder": 0.3}}
    model = RobotModel.load(write_arm(tmp_path, "geared", transmission=part))
    raw, motion = FakeArm(start=10.0), SafeMotion.load(commands, model)
    log = play(ModelArm(raw, model, MotorUnits("degrees")), motion)
    assert np.allclose(log.command, motion.command) and np.allclose(log.position, log.command, atol=0.1)
    motors = np.radians([u for _, u in raw.sent[-len(motion.time) :]])
    linear = np.array(part["matrix"]) * [1, -1]
    assert np.allclose((motors - [0.3, 0.0]) @ linear.T, motion.command, atol=1e-9)
    assert np.abs(log.effort).max() > 0.1


def stub(name: str, **contents: Any) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(contents)
    return module


def run_example(name: str, monkeypatch: pytest.MonkeyPatch, modules: dict[str, ModuleType], *words: str) -> None:
    for key, module in modules.items():
        monkeypatch.setitem(sys.modules, key, module)
    monkeypatch.setattr(sys, "argv", [name, *words])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def test_the_example_with_lerobots_classes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bus in LeRobot's degrees, whose gripper goes from 0 to 100."""
    model = RobotModel.load("so101")
    arm = FakeArm(6, 0.0)
    names = list(model.joints)
    bus = SimpleNamespace(
        motors=dict.fromkeys(names),
        sync_read=lambda what: dict(zip(names, arm.read().position.tolist(), strict=True)),
        sync_write=lambda what, values: arm.write(np.array([values[name] for name in names])),
    )
    monkeypatch.setattr("time.monotonic", arm.now)
    monkeypatch.setattr("time.sleep", lambda seconds: arm.move(seconds))
    config = lambda **given: SimpleNamespace(**given)  # noqa: E731

    class Robot:
        def __init__(self, config: Any) -> None:
            assert config.use_degrees and (config.port, config.id) == ("/dev/x", "mine")
            self.bus = bus

        def __enter__(self) -> Robot:
            return self

        def __exit__(self, *error: Any) -> None:
            pass

    time = np.arange(50) / 50
    wave = 0.3 * np.sin(np.pi * time) ** 2
    command = np.column_stack([time, *[wave] * 6])
    header = ",".join(["time", *(f"{name}.command" for name in names)])
    np.savetxt(tmp_path / "next.csv", command, "%.6f", ",", header=header, comments="")
    module = stub("lerobot.robots.so_follower", SO101Follower=Robot, SO101FollowerConfig=config)
    words = [str(tmp_path / "next.csv"), str(tmp_path / "log.csv"), "/dev/x", "mine"]
    run_example("record_lerobot.py", monkeypatch, {"lerobot.robots.so_follower": module}, *words)
    (log,) = load_recordings(tmp_path / "log.csv")
    assert np.allclose(log.command, command[:, 1:], atol=1e-6) and np.allclose(log.position, log.command, atol=0.1)
    high = max(arm.sent[-50:], key=lambda one: one[1][0])[1]
    assert high[0] == pytest.approx(degrees(0.3) * 4096 / 4095, abs=1e-3) and high[5] == pytest.approx(30.0, abs=1e-3)


def test_the_example_with_ross_classes(model, commands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Joint states arrive at 100 Hz, in another order; the driver stamps them 2 ms before they arrive."""
    arm, callbacks = FakeArm(start=0.0), []

    def spin_once(node: Any, timeout_sec: float) -> None:
        arm.move(min(timeout_sec, 0.01) + 1e-6)
        nanoseconds = round((arm.clock - 0.002) * 1e9)
        stamp = SimpleNamespace(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        state = SimpleNamespace(
            header=SimpleNamespace(stamp=stamp), name=["elbow", "shoulder"], position=arm.position[::-1].tolist()
        )
        callbacks[0](state)

    node = SimpleNamespace(
        create_subscription=lambda kind, topic, callback, depth: callbacks.append(callback),
        create_publisher=lambda kind, topic, depth: SimpleNamespace(publish=lambda one: arm.write(np.array(one.data))),
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(arm.clock * 1e9))),
    )
    modules = {
        "rclpy": stub("rclpy", create_node=lambda name: node, spin_once=spin_once, init=lambda: None),
        "sensor_msgs.msg": stub("sensor_msgs.msg", JointState=object),
        "std_msgs.msg": stub("std_msgs.msg", Float64MultiArray=lambda data: SimpleNamespace(data=data)),
    }
    words = [str(tmp_path / "two.json"), str(commands), str(tmp_path / "log.csv")]
    run_example("record_ros2.py", monkeypatch, modules, *words)
    (log,) = load_recordings(tmp_path / "log.csv")
    assert log.hz == pytest.approx(50.0, rel=1e-3) and np.allclose(log.position, log.command, atol=0.1)
    assert np.ptp(log.command[:, 1]) == pytest.approx(0.3, abs=1e-3)
