"""Films README's moving picture in the real workbench (needs viser, playwright and chromium; a few minutes).

The demo's arm: nominal, fitted, with Stribeck friction on three joints by hand, fitted again; the held-out error falls.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from embodiedreamer_gym.demo import DATA  # noqa: E402
from embodiedreamer_gym.recordings import load_recordings  # noqa: E402
from embodiedreamer_gym.robot import RobotModel  # noqa: E402
from embodiedreamer_gym.workbench.page import Page  # noqa: E402
from embodiedreamer_gym.workbench.session import Session  # noqa: E402
from tests.workbench.browser import Tab, browser  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "workbench.webp"
WORK = 600.0  # s, the most that a fit takes
SIZE = (800, 500)  # pixels; the page is filmed at 1.6 times that
SHORT, LONG = 200, 1600  # ms that a picture is shown


class Film:
    """Pictures of a tab, each with the milliseconds that it is shown."""

    def __init__(self, tab: Tab, page: Page) -> None:
        self.tab, self.page = tab, page
        self.pictures: list[Image.Image] = []
        self.milliseconds: list[int] = []

    def take(self, milliseconds: int) -> None:
        """Take a picture when the page has drawn everything."""
        self.page.actions.wait(WORK)
        self.tab.page.wait_for_timeout(1200.0)
        picture = Image.open(io.BytesIO(self.tab.page.screenshot())).convert("RGB")
        self.pictures.append(picture.resize(SIZE, Image.Resampling.LANCZOS))
        self.milliseconds.append(milliseconds)

    def play(self, count: int) -> None:
        """Take pictures along the recording, the last one for longer."""
        for k in range(count):
            self.tab.drag("time [s]", 0.1 + 0.8 * k / (count - 1))
            self.take(SHORT if k < count - 1 else LONG)

    def drag(self, slider: str, end: float, count: int) -> None:
        """Take pictures while a slider moves."""
        for k in range(1, count + 1):
            self.tab.drag(slider, end * k / count)
            self.take(SHORT if k < count else LONG)

    def write(self, path: Path) -> None:
        """Write an animated WebP that repeats."""
        first, *others = self.pictures
        first.save(path, save_all=True, append_images=others, duration=self.milliseconds, loop=0, quality=55, method=6)


def main(folder: Path) -> None:
    """Film the demo."""
    model, logs = RobotModel.load(DATA / "model.json"), [load_recordings(DATA / part) for part in ("train", "test")]
    page = Page(Session(model, *logs, folder / "better.json"), port=0)
    with browser() as chromium:
        tab = Tab(chromium, page.url, (1280, 800))
        tab.ready()
        film = Film(tab, page)
        film.play(6)
        tab.press("fit")
        page.actions.wait(WORK)
        tab.press("keep")
        film.play(4)
        tab.choose("effect", "stribeck_friction")
        tab.see("slider for")
        tab.open("joints")
        for joint in ("joint4", "joint5", "joint6"):
            tab.check(joint)
        film.drag("sliding", 0.27, 6)
        tab.press("fit")
        film.take(LONG)
        film.play(6)
    page.close()
    film.write(PICTURE)
    print(f"{PICTURE.relative_to(ROOT)}: {len(film.pictures)} pictures, {PICTURE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as work:
        main(Path(work))
