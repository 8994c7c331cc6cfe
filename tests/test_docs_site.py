"""The site: strict, small pictures, no dead link, no request to any server, nothing wider than the window, search offline."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytest.importorskip("mkdocs", reason="mkdocs is not installed")

from tests.workbench.browser import CHROMIUM, browser

ROOT = Path(__file__).parents[1]
MOST_PICTURES = 6_000_000  # bytes
PATIENCE = 120_000  # ms, on a busy machine
LOADED = "document.querySelectorAll('img').forEach(i => i.loading = 'eager'); document.readyState === 'complete'"
BROKEN = "[...document.images].filter(i => !i.complete || !i.naturalWidth).map(i => i.src)"


class Page(HTMLParser):
    """The names that a page can be entered at, and what it links to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if value and key in ("id", "name"):
                self.names.add(value)
            elif value and key in ("href", "src"):
                self.links.add(value)


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
    pages = {p.relative_to(site).as_posix() for p in site.rglob("*.html")} - {"index.html"}
    article = home[home.index("<article") : home.index("</article")]
    assert pages - set(re.findall(r'href="([^"#]+\.html)', article)) == set()


@pytest.mark.slow
def test_links_lead_to_a_file_and_a_place_in_it(site: Path) -> None:
    pages = {path.resolve(): Page(path) for path in site.rglob("*.html")}
    dead = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file() or (
                parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].names
            ):
                dead.append(f"{path.name}: {link}")
    assert dead == []


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="neither chromium, chromium-browser nor google-chrome is installed")
def test_pages_fit_and_ask_no_server(site: Path) -> None:
    with browser() as chromium:
        page = chromium.new_page()
        page.set_default_timeout(PATIENCE)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        wide, broken = [], []
        for path in sorted(site.rglob("*.html")):
            page.goto(path.as_uri())
            page.wait_for_function(LOADED)
            broken += page.evaluate(BROKEN)
            for width in (400, 1200):
                page.set_viewport_size({"width": width, "height": 900})
                if page.evaluate("document.documentElement.scrollWidth") > width:
                    wide.append(f"{path.relative_to(site)} at {width}")
        assert wide == [] and broken == []
        assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
        page.goto((site / "index.html").as_uri())
        page.locator("input[name=query]").press_sequentially("backlash")  # the search listens to keys
        page.wait_for_selector(".md-search-result__link")
        page.set_viewport_size({"width": 400, "height": 900})
        page.goto((site / "tutorials" / "own_arm.html").as_uri())
        page.locator(".md-header label[for=__drawer]").first.click()
        page.locator(".md-nav").get_by_role("link", name="Your own task").locator("visible=true").first.click()
        page.wait_for_url("**/own_task.html")
