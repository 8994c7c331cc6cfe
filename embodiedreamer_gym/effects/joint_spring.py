"""Joint spring: a cable or a gravity spring that pulls the joint towards an angle."""

from embodiedreamer_gym.effects.effect import Parameter, SignalLaw


class JointSpring(SignalLaw):
    """A linear spring between the links, -k (q - q0)."""

    name = "joint_spring"
    family = "gravity"
    stage = "load"
    parameters = (
        Parameter("stiffness", "N m/rad", off=0.0, low=0.0, high=60.0, typical=0.2, scale="torque"),
        Parameter("angle", "rad", off=0.0, low=-3.2, high=3.2, typical=0.3, shape=True),
    )
    symptom = "the error grows with the distance from one angle of the joint"
    reveals = "a slow sweep of one joint through its range"
    confused_with = ("torque_bias", "base_tilt", "payload", "encoder_offset", "torque_ripple", "hysteresis")
    generalises = ("torque_bias",)

    @staticmethod
    def law(signal, joint, memory, p):
        """Add the spring's torque (B, n) N m."""
        return signal - p.stiffness * (joint.position - p.angle), memory
