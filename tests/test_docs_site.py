"""The site: built strictly, small pictures, no request to any server, nothing wider than the window, search that works offline."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mkdocs", reason="mkdocs is not installed")

from tests.workbench.browser import CHROMIUM, browser

ROOT = Path(__file__).parents[1]
MOST_PICTURES = 6_000_000  # bytes
PATIENCE = 120_000  # ms, on a busy machine
SHOWN = (
    "index.html",
    "results.html",
    "tutorials/own_arm.html",
    "reference/diagnosis.html",
    "reference/command_line.html",
    "gallery.html",
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.mark.slow
def test_pictures_are_small_and_home_links_to_every_page(site: Path) -> None:
    pictures = [
        p for p in (site / "images").rglob("*") if p.suffix in (".png", ".jpg", ".svg", ".webp", ".gif", ".mp4")
    ]
    assert len(pictures) > 20 and sum(p.stat().st_size for p in pictures) <= MOST_PICTURES
    home = (site / "index.html").read_text()
    pages = {p.relative_to(site).as_posix() for p in site.rglob("*.html")} - {"404.html", "index.html"}
    article = home[home.index("<article") : home.index("</article")]
    assert pages - set(re.findall(r'href="([^"#]+\.html)', article)) == set()


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="neither chromium, chromium-browser nor google-chrome is installed")
def test_pages_fit_and_ask_no_server(site: Path) -> None:
    with browser() as chromium:
        for width in (1200, 400):
            page = chromium.new_page(viewport={"width": width, "height": 900})
            page.set_default_timeout(PATIENCE)
            asked: list[str] = []
            page.on("request", lambda request, asked=asked: asked.append(request.url))
            for name in SHOWN:
                page.goto((site / name).as_uri())
                page.wait_for_timeout(300)
                assert page.evaluate("document.documentElement.scrollWidth") <= width, name
            assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
        page.set_viewport_size({"width": 1200, "height": 900})
        page.goto((site / "index.html").as_uri())
        page.locator("input[name=query]").press_sequentially("backlash")  # the search listens to keys
        page.wait_for_selector(".md-search-result__link")
