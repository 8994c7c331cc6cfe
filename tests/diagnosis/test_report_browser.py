"""The report as a browser shows it: at the width of a laptop and of a phone, with no request leaving the file."""

from __future__ import annotations

import json
import subprocess
from html import escape, unescape
from pathlib import Path

import cv2
import pytest

from embodiedreamer_gym.diagnosis import error_breakdown
from embodiedreamer_gym.diagnosis.report import write_report
from embodiedreamer_gym.diagnosis.report.sentences import verdict_sentence
from tests.chromium import CHROMIUM, needs_chromium
from tests.diagnosis.test_report import answer
from tests.two_joint_arm import load_arm, record

SCREENS = {1280: 800, 400: 800}
LONG = "a_robot_arm_whose_file_has_got_a_name_that_fills_more_than_any_line_of_a_phone_" * 2
# The page stands in a frame as wide as a screen; what the frame's document measures is written into the outer page.
FRAME = """<!DOCTYPE html><html><body><pre id="found">nothing</pre>
<iframe id="page" style="width:{width}px;height:{height}px;border:0" srcdoc="{page}"></iframe><script>
document.getElementById("page").onload = (event) => {{
  const inner = event.target.contentWindow, page = inner.document, root = page.documentElement;
  const all = [...page.querySelectorAll("*")];
  document.getElementById("found").textContent = JSON.stringify({{
    width: inner.innerWidth, scroll: Math.max(root.scrollWidth, page.body.scrollWidth),
    images: [...page.images].map(i => [i.alt, i.naturalWidth, i.naturalHeight, i.clientWidth]),
    links: all.flatMap(e => ["src", "href", "srcset", "data", "action"].map(a => e.getAttribute(a)).filter(x => x)),
    requests: inner.performance.getEntriesByType("resource").map(r => r.name),
    verdict: [page.querySelector(".verdict").textContent, page.querySelector(".verdict").getBoundingClientRect().bottom],
  }});
}};
</script></body></html>"""

pytestmark = [
    needs_chromium,
]


def browse(folder: Path, *arguments: str) -> str:
    """What a browser without a window prints."""
    quiet = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=20000"]
    command = [str(CHROMIUM), *quiet, f"--user-data-dir={folder / 'profile'}", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory):
    """A diagnosis of the delayed arm, whose model has a very long name."""
    folder = tmp_path_factory.mktemp("arm")
    arm = load_arm(folder).with_(name=LONG)
    delayed = arm.with_effect("command_delay").with_values({"command_delay.seconds": {"shoulder": 0.03}})
    logs = [record(delayed, f"wave_{LONG}_{s}", 5e-4, seed=s) for s in range(2)]
    found = answer(arm, delayed)
    return found, write_report(
        folder / "report", diagnosis=found, breakdown=error_breakdown(arm, logs), recordings=logs
    )


def measure(folder: Path, page: str, width: int) -> dict:
    """What a screen of that width shows of a page."""
    text = FRAME.format(width=width, height=SCREENS[width], page=escape(page))
    (folder / "frame.html").write_text(text, encoding="utf-8")
    size = f"--window-size={width + 100},{SCREENS[width] + 100}"
    shown = browse(folder, size, "--dump-dom", (folder / "frame.html").as_uri())
    return json.loads(unescape(shown.partition('<pre id="found">')[2].partition("</pre>")[0]))


@pytest.fixture(scope="module", params=SCREENS)
def seen(diagnosis, request, tmp_path_factory):
    """The report on a screen of that width."""
    found = measure(tmp_path_factory.mktemp("frame"), diagnosis[1].read_text(encoding="utf-8"), request.param)
    assert found["width"] == request.param
    return found


def test_the_measurement_finds_what_is_wrong(tmp_path: Path) -> None:
    bad = '<p class="verdict" style="margin-top:900px">late</p><img alt="" src="http://127.0.0.1:9/a.png"><hr style="width:2000px">'
    found = measure(tmp_path, bad, 400)
    assert found["scroll"] > 1900 and found["verdict"][1] > 900 and found["links"] == ["http://127.0.0.1:9/a.png"]
    assert found["images"][0][:2] == ["", 0] and found["requests"] == found["links"]


def test_the_page_is_no_wider_than_the_screen(seen) -> None:
    assert seen["scroll"] <= seen["width"]


def test_every_picture_is_there_and_has_words(seen) -> None:
    images = seen["images"]
    assert len(images) == 6
    assert all(len(alt) > 10 and wide > 1000 and high > 100 and shown > 300 for alt, wide, high, shown in images)


def test_nothing_is_asked_of_the_network(seen) -> None:
    links = seen["links"]
    assert len(links) >= 6 and all(link.startswith(("data:", "#")) for link in links)
    assert all(name.startswith("data:") for name in seen["requests"])


def test_the_verdict_is_on_the_first_screen(seen, diagnosis) -> None:
    sentence, bottom = seen["verdict"]
    assert sentence == verdict_sentence(diagnosis[0].as_dict())
    assert bottom < SCREENS[seen["width"]]


@pytest.mark.parametrize("width", SCREENS)
def test_a_screenshot_shows_something(diagnosis, width: int, tmp_path: Path) -> None:
    path = tmp_path / "shot.png"
    browse(tmp_path, f"--screenshot={path}", f"--window-size={width},{SCREENS[width]}", diagnosis[1].as_uri())
    pixels = cv2.imread(str(path))
    assert pixels is not None and pixels.shape == (SCREENS[width], width, 3) and pixels.std() > 10
