"""Takes the pictures of docs/workbench.md from the real page (needs viser, playwright and chromium; minutes)."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from embodiedreamer_gym.demo import DATA  # noqa: E402
from embodiedreamer_gym.recordings import load_recordings  # noqa: E402
from embodiedreamer_gym.robot import RobotModel  # noqa: E402
from embodiedreamer_gym.workbench.page import Page  # noqa: E402
from embodiedreamer_gym.workbench.session import Session  # noqa: E402
from tests.workbench.browser import Tab, browser  # noqa: E402

PICTURES = ROOT / "docs" / "images" / "workbench"
WORK = 600.0  # s, the most that a fit or a diagnosis takes


def main(folder: Path) -> None:
    """Go through the demo as a user would, and take a picture at each stage."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    model, logs = RobotModel.load(DATA / "model.json"), [load_recordings(DATA / part) for part in ("train", "test")]
    page = Page(Session(model, *logs, folder / "better.json"), game=True, port=0)
    with browser() as chromium:
        tab = Tab(chromium, page.url)
        tab.ready()
        tab.tab("Where it fails")
        tab.picture(PICTURES / "where.png")
        tab.press("rev.", 1)
        tab.tab("Motion")
        tab.picture(PICTURES / "motion.png")
        tab.press("fit")
        page.actions.wait(WORK)
        tab.press("keep")
        tab.choose("effect", "stribeck_friction")
        tab.see("slider for")
        tab.drag("sliding", 0.27)
        page.actions.wait(WORK)
        tab.picture(PICTURES / "try.png")
        tab.tab("Diagnose")
        tab.press("diagnose")
        page.actions.wait(WORK)
        tab.press("show the diagnosed model")
        page.actions.wait(WORK)
        tab.picture(PICTURES / "diagnose.png")
        tab.tab("Next motion")
        tab.press("propose a motion")
        page.actions.wait(WORK)
        tab.picture(PICTURES / "next.png", 3000.0)
        print("errors in the console:", tab.errors)
    page.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as work:
        main(Path(work))
