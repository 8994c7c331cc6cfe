"""Play a motion of `embodiedreamer excite` on a ROS 2 arm (forward_position_controller); log with driver stamps."""

import sys

import numpy as np
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

import embodiedreamer_gym as er
from embodiedreamer_gym.robot.play import ModelArm, SafeMotion, Sample, play


class RosArm:
    def __init__(self, joints: tuple[str, ...]) -> None:  # in the controller's order
        self.node, self.joints, self.state = rclpy.create_node("record"), joints, None
        self.node.create_subscription(JointState, "/joint_states", lambda state: setattr(self, "state", state), 10)
        self.publisher = self.node.create_publisher(Float64MultiArray, "/forward_position_controller/commands", 10)

    def now(self) -> float:
        return self.node.get_clock().now().nanoseconds / 1e9

    def wait(self, until: float) -> None:
        while self.now() < until:
            rclpy.spin_once(self.node, timeout_sec=until - self.now())

    def read(self) -> Sample:
        rclpy.spin_once(self.node, timeout_sec=0.0 if self.state else 5.0)
        stamp, columns = self.state.header.stamp, [self.state.name.index(joint) for joint in self.joints]
        return Sample(stamp.sec + stamp.nanosec / 1e9, np.array(self.state.position)[columns])

    def write(self, command: np.ndarray) -> None:
        self.publisher.publish(Float64MultiArray(data=command.tolist()))


if __name__ == "__main__":
    source, commands, log = sys.argv[1:]  # my_arm.json next.csv log.csv
    model, _ = er.RobotModel.load(source), rclpy.init()
    names = model.joints if model.transmission is None else model.transmission.motors
    print(er.save_recording(play(ModelArm(RosArm(names), model), SafeMotion.load(commands, model)), log))
