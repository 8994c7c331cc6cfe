"""Draw docs/images/staircase.png, the README's picture, from the demo's recordings: python docs/make_picture.py."""

from __future__ import annotations

from pathlib import Path

from embodiedreamer_gym import RobotModel, diagnose, load_recordings
from embodiedreamer_gym.demo import DATA
from embodiedreamer_gym.diagnosis.report.result_figures import staircase

OUT = Path(__file__).parent / "images" / "staircase.png"
SIZE = (6.6, 3.1)  # in; narrower than in the report, so that its type is larger on the README's page
RESOLUTION = 250  # dots per inch


def main() -> None:
    """Diagnose the demo's arm and draw how its error falls."""
    model = RobotModel.load(DATA / "model.json")
    found = diagnose(model, load_recordings(DATA / "train"), load_recordings(DATA / "test"))
    figure = staircase(found.steps, found.error["noise"] or 0.0)
    figure.set_size_inches(*SIZE)
    figure.savefig(OUT, dpi=RESOLUTION, metadata={"Software": None})
    print(f"{OUT}: {', '.join(f'{label} {1e3 * error:.2f} mrad' for label, error in found.steps)}")


if __name__ == "__main__":
    main()
