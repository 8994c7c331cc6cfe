"""Is it my own idea that the model lacks? An effect of fifteen lines, fitted beside one of the catalogue. (20 s)"""

from __future__ import annotations

import numpy as np

import embodiedreamer_gym as er
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.effects import Parameter, TorqueBudget


class DampedFriction(TorqueBudget):
    """Dry friction that fades in with speed, as of a felt seal."""

    name = "felt_friction"
    parameters = (Parameter("torque", "N m", off=0.0, low=0.0, high=2.0, typical=0.1, scale="torque"),)
    symptom = "the joint is held back in motion, but lets go at rest"
    reveals = "slow sweeps beside holds"

    @staticmethod
    def friction(joint, p):
        torque = p.torque * np.tanh(np.abs(joint.velocity) / 0.2)
        return torque, torque  # of a forward and of a backward motion


def main() -> None:
    model = er.RobotModel.load(DATA / "model.json")
    train, test = er.load_recordings(DATA / "train"), er.load_recordings(DATA / "test")
    model = model.with_(catalogue={**model.catalogue, DampedFriction.name: DampedFriction})
    for name in (DampedFriction.name, "coulomb_friction"):
        before, after = er.add_effect(model, name, train, test).comparison.error
        print(f"{name:<18} held-out error {1e3 * before:.2f} -> {1e3 * after:.2f} mrad")


if __name__ == "__main__":
    main()
