"""Errors of the URDF's masses: never named as an effect, but estimated by fits together with the effects."""

import numpy as np

from embodiedreamer_gym.effects.effect import MechanicsChange, Parameter


class InertialError(MechanicsChange):
    """Errors of each moving body's mass, centre of mass and inertia; a body has the name of its joint.

    Every value of these parameters gives a body that can exist: the mass is multiplied by exp(mass), and the second
    moments about the centre of mass are those of the body stretched along its axes by exp(stretch), so that they stay
    positive definite and the principal inertias satisfy the triangle inequality.
    Source: Rucker and Wensing, IEEE Robotics and Automation Letters 7(2), 2022 (the log-Cholesky form, without shear).
    """

    name = "inertial_error"
    parameters = (
        Parameter("mass", "1", off=0.0, low=-3.0, high=3.0, typical=1.0, scale="urdf_mass", prior=True),
        *(Parameter(axis, "m", off=0.0, low=-3.0, high=3.0, typical=1.0, scale="urdf_centre", prior=True) for axis in "xyz"),
        *(Parameter(f"stretch_{axis}", "1", off=0.0, low=-3.0, high=3.0, typical=1.0, scale="urdf_stretch",
                    prior=True) for axis in "xyz"),
    )  # fmt: skip
    symptom = "every joint has a small error that does not follow the pattern of a servo or a friction law"
    reveals = "weighing the links"

    @staticmethod
    def change(mechanics, p):
        """Change mass, centre and inertia of body j by column j of the parameters (B, n), for the first n bodies."""
        stretch = np.exp(np.stack([p.stretch_x, p.stretch_y, p.stretch_z], axis=-1))
        shift = np.stack([p.x, p.y, p.z], axis=-1)
        for j in range(p.mass.shape[1]):
            mass = mechanics.mass[:, j, None].copy()
            centre = mechanics.first_moment[:, j] / np.maximum(mass, 1e-12)
            spread = _second_moment(mechanics.inertia[:, j]) - (mass * centre)[:, :, None] * centre[:, None, :]
            spread = spread * stretch[:, j, :, None] * stretch[:, j, None, :]
            factor, centre = np.exp(p.mass[:, j, None]), centre + shift[:, j]
            moment = factor[:, :, None] * (spread + (mass * centre)[:, :, None] * centre[:, None, :])
            mechanics.mass[:, j] *= factor[:, 0]
            mechanics.first_moment[:, j] = factor * mass * centre
            mechanics.inertia[:, j] = np.trace(moment, axis1=1, axis2=2)[:, None, None] * np.eye(3) - moment


def _second_moment(inertia):
    """Second moments (B, 3, 3) kg m^2, the integral of r r^T, of inertias (B, 3, 3) about the same point."""
    return 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
