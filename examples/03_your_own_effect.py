"""Does the model lack an effect of your own? It takes fifteen lines, and is compared with a built-in one. (15 s)"""

from __future__ import annotations

import numpy as np

import embodiedreamer_gym as er
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.effects import Parameter, TorqueBudget


class GreasedFriction(TorqueBudget):
    """Dry friction that falls to less than half as soon as motion draws grease between the teeth."""

    name = "greased_friction"
    parameters = (Parameter("torque", "N m", off=0.0, low=0.0, high=2.0, typical=0.1, scale="torque"),)
    symptom = "the joint breaks loose with a jerk, then runs more easily"
    reveals = "slow sweeps beside fast ones"

    @staticmethod
    def friction(joint, p):
        torque = p.torque * (0.4 + 0.6 * np.exp(-np.abs(joint.velocity) / 0.1))
        return torque, torque  # for forward and for backward motion


def main() -> None:
    model = er.RobotModel.load(DATA / "model.json")
    train, test = er.load_recordings(DATA / "train"), er.load_recordings(DATA / "test")
    model = model.with_(catalogue={**model.catalogue, GreasedFriction.name: GreasedFriction})
    for name in (GreasedFriction.name, "coulomb_friction"):
        before, after = er.add_effect(model, name, train, test).comparison.error
        print(f"{name:<18} held-out error {1e3 * before:.2f} -> {1e3 * after:.2f} mrad")


if __name__ == "__main__":
    main()
