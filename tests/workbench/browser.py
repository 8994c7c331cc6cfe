"""A browser without a window on the workbench: Playwright drives the chromium that is installed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tests.chromium import CHROMIUM

ARGUMENTS = (
    "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--disable-component-update",
)  # fmt: skip
DRAWN = 60_000  # ms; software WebGL is slow


def until(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait until a condition holds. Raises: TimeoutError after some seconds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("it did not happen in time")
        time.sleep(0.02)


@contextmanager
def browser() -> Iterator[Any]:
    """Playwright's browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        try:
            yield chromium
        finally:
            chromium.close()


class Tab:
    """A tab with the workbench; errors: what its console called an error; requests: addresses that it asked."""

    def __init__(self, chromium: Any, url: str, size: tuple[int, int] = (1440, 900)) -> None:
        self.page = chromium.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.set_default_timeout(DRAWN)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(url)
        self.page.wait_for_selector("canvas")

    def ready(self) -> None:
        """Wait for the first error to be shown, and close the note about software WebGL."""
        self.see("dashed: sensor noise")
        for button in self.page.locator(".mantine-Notification-closeButton").all():
            button.click()

    def see(self, text: str, seconds: float = DRAWN / 1e3) -> None:
        """Wait until a text can be seen."""
        self.page.get_by_text(text).locator("visible=true").first.wait_for(timeout=1e3 * seconds)

    def tab(self, name: str) -> None:
        """Open one of the panels' tabs."""
        self.page.get_by_role("tab", name=name).first.click()

    def press(self, name: str, which: int = 0) -> None:
        """Press the button of that name; which: of several."""
        self.page.get_by_role("button", name=name, exact=True).locator("visible=true").nth(which).click()

    def choose(self, label: str, option: str) -> None:
        """Choose an option of a list."""
        self.page.locator(f"xpath=//label[normalize-space(.)='{label}']/following::input[1]").locator(
            "visible=true"
        ).first.click()
        self.page.get_by_role("option", name=option, exact=True).locator("visible=true").first.click()

    def track(self, label: str) -> dict[str, float]:
        """Where a slider's track is: x, y, width and height, pixels."""
        return self.page.locator(
            f"xpath=//label[normalize-space(.)='{label}']/following::*[contains(@class,'Slider-trackContainer')][1]"
        ).bounding_box()

    def drag(self, label: str, share: float) -> None:
        """Drag a slider to a share of its way."""
        box = self.track(label)
        x, y = box["x"], box["y"] + box["height"] / 2
        self.page.mouse.move(x + 2, y)
        self.page.mouse.down()
        for part in range(1, 9):
            self.page.mouse.move(x + share * box["width"] * part / 8, y)
        self.page.mouse.up()

    def open(self, folder: str) -> None:
        """Open a folder."""
        self.page.get_by_text(folder, exact=True).locator("visible=true").first.click()

    def check(self, label: str) -> None:
        """Click a checkbox."""
        box = f"xpath=//label[normalize-space(.)='{label}']/following::input[@type='checkbox'][1]"
        self.page.locator(box).locator("visible=true").first.click()

    def arms(self, path: Path) -> tuple[int, int]:
        """Pixels of the scene in the colours of the ghost, and in those of links that err; the picture is written."""
        self.picture(path)
        blue, _, red = np.moveaxis(cv2.imread(str(path)).astype(int)[:, 440:1030], -1, 0)
        return int((blue - red > 30).sum()), int((red - blue > 30).sum())

    def text(self) -> str:
        """All text of the page."""
        return self.page.locator("body").inner_text()

    def picture(self, path: Path, wait: float = 1500.0) -> None:
        """Write a picture of the page, after some ms."""
        self.page.wait_for_timeout(wait)
        self.page.screenshot(path=str(path))
