"""How large is the error of a model, and how much of it is due to wrong servo gains? (a few seconds)"""

from __future__ import annotations

import embodiedreamer_gym as er
from embodiedreamer_gym.demo import DATA


def main() -> None:
    model = er.RobotModel.load(DATA / "model.json")  # or RobotModel.load("my_arm.json")
    train = er.load_recordings(DATA / "train")
    test = er.load_recordings(DATA / "test")

    fit = er.calibrate(model, train)
    print(fit)  # every parameter with its 95 % interval
    print()
    print(er.compare([model, fit.model], test, labels=["before", "calibrated"]))
    print()
    for finding in er.error_breakdown(fit.model, test).findings:  # the remaining error, and what it correlates with
        print(f"- {finding}")


if __name__ == "__main__":
    main()
