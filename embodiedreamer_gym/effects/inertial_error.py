"""Errors of the URDF's masses: not an effect to be named, but what no verdict may be blamed on."""

from embodiedreamer_gym.effects.effect import MechanicsChange, Parameter


class InertialError(MechanicsChange):
    """Relative error of each moving body's mass and an offset of its centre of mass; joint names stand for bodies."""

    name = "inertial_error"
    parameters = (
        Parameter("mass", "1", off=0.0, low=-0.5, high=0.5, typical=0.02),
        Parameter("x", "m", off=0.0, low=-0.05, high=0.05, typical=0.002),
        Parameter("y", "m", off=0.0, low=-0.05, high=0.05, typical=0.002),
        Parameter("z", "m", off=0.0, low=-0.05, high=0.05, typical=0.002),
    )
    symptom = "every joint errs a little, in no pattern that a servo or a friction law has"
    reveals = "weighing the links"

    @staticmethod
    def change(mechanics, p):
        """Scale mass and inertia of body j, and move its centre of mass (B, n); the first n bodies are meant."""
        for j in range(p.mass.shape[1]):
            factor = 1.0 + p.mass[:, j]
            mechanics.mass[:, j] *= factor
            mechanics.first_moment[:, j] *= factor[:, None]
            mechanics.inertia[:, j] *= factor[:, None, None]
            for axis, shift in enumerate((p.x, p.y, p.z)):
                mechanics.first_moment[:, j, axis] += mechanics.mass[:, j] * shift[:, j]
