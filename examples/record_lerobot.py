"""Play a motion of `embodiedreamer excite` on an SO-101 and log it with measured stamps; use LeRobot's Python."""

from __future__ import annotations

import argparse
import time

import numpy as np
from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig

import embodiedreamer_gym as er
from embodiedreamer_gym.robot.play import ModelArm, SafeMotion, Sample, motor_units, play


class LeRobotArm:
    """LeRobot's motors, in LeRobot's degrees; a time stamp is the middle of the time spent reading the bus."""

    def __init__(self, robot: SO101Follower) -> None:
        self.robot, self.now = robot, time.monotonic

    def wait(self, until: float) -> None:
        time.sleep(max(until - self.now(), 0.0))

    def read(self) -> Sample:
        before, positions = self.now(), self.robot.bus.sync_read("Present_Position")
        return Sample((before + self.now()) / 2, np.array([positions[name] for name in self.robot.bus.motors]))

    def write(self, command: np.ndarray) -> None:
        self.robot.bus.sync_write("Goal_Position", dict(zip(self.robot.bus.motors, command.tolist(), strict=True)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name, text in (("commands", "FILE.csv of excite"), ("log", "FILE.csv to write"), ("port", "such as /dev/ttyACM0"), ("id", "of the calibration")):  # fmt: skip
        parser.add_argument(name, help=text)
    a = parser.parse_args()
    model = er.RobotModel.load("so101")
    with SO101Follower(SO101FollowerConfig(port=a.port, id=a.id, use_degrees=True)) as robot:
        arm = ModelArm(LeRobotArm(robot), model, motor_units(model, "degrees-middle", {}), "so101_follower")
        print(er.save_recording(play(arm, SafeMotion.load(a.commands, model)), a.log))
