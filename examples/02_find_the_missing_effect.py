"""Which effect does the model lack? Judged on held-out motions. (half a minute)"""

from __future__ import annotations

from pathlib import Path
from tempfile import mkdtemp

import embodiedreamer_gym as er
from embodiedreamer_gym.demo import DATA


def main() -> None:
    model = er.RobotModel.load(DATA / "model.json")
    train = er.load_recordings(DATA / "train")
    test = er.load_recordings(DATA / "test")

    found = er.diagnose(model, train, test)  # calibrates first
    print(found)
    for joint, share in found.unexplained.items():
        print(f"{share:.0%} of the error of {joint} is still unexplained")

    folder = Path(mkdtemp())
    found.model.save(folder / "better.json")  # the model with the effect
    print(er.write_report(folder / "report", diagnosis=found, recordings=test))


if __name__ == "__main__":
    main()
